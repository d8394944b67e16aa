"""The keys of every command and of flying, as a user has them: which can be changed, and which exclude each other."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QObject, QSettings, Signal
from PySide6.QtGui import QKeySequence

from app.actions import ActionTable
from app.views.hands import FLIGHTS, flying

_PREFIX = "keys/"


@dataclass(frozen=True)
class KeyRow:
    """id        of the command or of the flight, "" for what cannot be changed
    title     in words
    place     the menu it stands in, or where the key works
    default   the keys at first
    """

    id: str
    title: str
    place: str
    default: str


FIXED = (
    KeyRow("", "Nudge what is selected", "Select, over a view", "Arrow keys"),
    KeyRow("", "Give up, go back to Select, select nothing", "Editing, over a view", "Esc"),
    KeyRow("", "Take the last place back", "Measure, over a view", "Backspace"),
    KeyRow("", "Set the scale by the measured length", "Measure, over a view", "Return"),
    KeyRow("", "Turn, go, take back, begin again", "Walking as an agent", "Arrow keys, 0 to 9, Backspace, Home"),
    KeyRow("", "Next and previous frame, fit, leave", "A frame", "Page Down, Page Up, Home, Esc"),
    KeyRow("", "Smaller and larger brush", "Correcting a mask", "[, ]"),
    KeyRow("", "Accept, reject, rewrite, show, step", "The list of tasks", "A, R, E, Return, Left, Right"),
)
"""What works in one place alone."""


class KeyBindings(QObject):
    """changed(): a key is another. What differs from the first keys is remembered."""

    changed = Signal()

    def __init__(
        self,
        table: ActionTable,
        settings: QSettings,
        fly: Callable[[dict[int, tuple[int, int, int]]], object],
        parent: QObject | None = None,
    ) -> None:
        """`fly` takes the keys that fly, as `hands.Hands` has them."""
        super().__init__(parent)
        self._table, self._settings, self._fly = table, settings, fly
        self._flights = {id: flight.key for id, flight in FLIGHTS.items()}
        commands = (
            KeyRow(e.id, e.text.replace("&", "").rstrip("…"), e.menu.replace("&", ""), _portable(e.shortcut))
            for e in table.entries
        )
        flights = (KeyRow(id, flight.title, "3D view", flight.key) for id, flight in FLIGHTS.items())
        self.rows: tuple[KeyRow, ...] = (*commands, *flights, *FIXED)
        self._of = {row.id: row for row in self.rows if row.id}
        for id in self._of:
            stored = settings.value(_PREFIX + id)
            if stored is not None and not self._why_not(id, str(stored)):
                self._take(id, _portable(str(stored)))
        self._fly(flying(self._flights))

    def keys(self, row: KeyRow) -> str:
        """What does it now, "" for nothing."""
        if not row.id:
            return row.default
        return self._flights[row.id] if row.id in FLIGHTS else self._table.keys(row.id)

    def bind(self, id: str, keys: str) -> str:
        """Other keys for a command or a flight, "" for none. Returns "", or why they cannot be."""
        reason, keys = self._why_not(id, keys), _portable(keys)
        if reason:
            return reason
        if keys == self._of[id].default:
            self._settings.remove(_PREFIX + id)
        else:
            self._settings.setValue(_PREFIX + id, keys)
        self._take(id, keys)
        self._fly(flying(self._flights))
        self.changed.emit()
        return ""

    def reset(self, id: str) -> None:
        """The keys at first."""
        self.bind(id, self._of[id].default)

    def reset_all(self) -> None:
        for row in self._of.values():
            if self.keys(row) != row.default:
                self.reset(row.id)

    def conflicts(self) -> dict[str, tuple[str, ...]]:
        """Id -> the titles of what has the same keys: then neither does anything."""
        users: dict[str, list[KeyRow]] = defaultdict(list)
        for row in self._of.values():
            if self.keys(row):
                users[self.keys(row)].append(row)
        return {
            row.id: tuple(other.title for other in rows if other is not row)
            for rows in users.values()
            if len(rows) > 1
            for row in rows
        }

    def _why_not(self, id: str, keys: str) -> str:
        if id in FLIGHTS and keys and not flying({id: keys}):
            return "Flying takes a single letter, digit or named key, without Ctrl, Alt or Shift."
        if keys and QKeySequence(keys).isEmpty():
            return f"{keys} is no key."
        return ""

    def _take(self, id: str, keys: str) -> None:
        if id in FLIGHTS:
            self._flights[id] = keys
        else:
            self._table.bind(id, keys)


def _portable(keys: str) -> str:
    return QKeySequence(keys).toString()
