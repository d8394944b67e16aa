"""The keys of all commands and of flying, as the user has set them, with their conflicts."""

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
    """One row of the table of keys.

    id        of the command or flight; "" if the keys are fixed
    title     as shown to the user
    place     menu of the command, or where the keys work
    default   default keys
    """

    id: str
    title: str
    place: str
    default: str


FIXED = (
    KeyRow("", "Command palette", "Everywhere", "Ctrl+Shift+P"),
    KeyRow("", "Nudge the selection", "Select, over a view", "Arrow keys"),
    KeyRow("", "Cancel, return to Select, clear the selection", "Editing, over a view", "Esc"),
    KeyRow("", "Remove the last point", "Measure, over a view", "Backspace"),
    KeyRow("", "Set the scale from the measured length", "Measure, over a view", "Return"),
    KeyRow("", "Turn, move, undo, restart", "Walking as an agent", "Arrow keys, 0 to 9, Backspace, Home"),
    KeyRow("", "Next and previous frame, fit, leave", "A frame", "Page Down, Page Up, Home, Esc"),
    KeyRow("", "Smaller and larger brush", "Correcting a mask", "[, ]"),
    KeyRow("", "Accept, reject, rewrite, show, step", "The list of tasks", "A, R, E, Return, Left, Right"),
)
"""Fixed keys, which work only in one place."""


class KeyBindings(QObject):
    """Reads, changes, and stores the keys. changed(): a key changed. Only differences from the defaults are stored."""

    changed = Signal()

    def __init__(
        self,
        table: ActionTable,
        settings: QSettings,
        fly: Callable[[dict[int, tuple[int, int, int]]], object],
        parent: QObject | None = None,
    ) -> None:
        """`fly` receives the flight keys in the form that `hands.Hands` uses."""
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
        """The current keys of a row, or "" if it has none."""
        if not row.id:
            return row.default
        return self._flights[row.id] if row.id in FLIGHTS else self._table.keys(row.id)

    def bind(self, id: str, keys: str) -> str:
        """Sets the keys of a command or flight; "" removes them. Returns "" or the reason why the keys are refused."""
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
        """Restores the default keys of a command or flight."""
        self.bind(id, self._of[id].default)

    def reset_all(self) -> None:
        for row in self._of.values():
            if self.keys(row) != row.default:
                self.reset(row.id)

    def conflicts(self) -> dict[str, tuple[str, ...]]:
        """Row id -> titles of the other rows with equal keys. Such keys run none of the commands."""
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
            return "A flight key must be a single letter, digit, or named key, without Ctrl, Alt, or Shift."
        if keys and QKeySequence(keys).isEmpty():
            return f"{keys} is not a key."
        return ""

    def _take(self, id: str, keys: str) -> None:
        if id in FLIGHTS:
            self._flights[id] = keys
        else:
            self._table.bind(id, keys)


def _portable(keys: str) -> str:
    return QKeySequence(keys).toString()
