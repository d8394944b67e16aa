"""The preferences for all projects, and the keys of all commands and of flying, as the user has set them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from PySide6.QtCore import QObject, QSettings, Signal
from PySide6.QtGui import QKeySequence

from nvsim.kernel_threads import cores
from nvsim_app.actions import ActionTable
from nvsim_app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL
from nvsim_app.views.navigation import FLIGHTS, MOTIONS, flight_directions

Value = str | bool | float
BUDGETS = (0, 400_000, 200_000, 100_000, 50_000)  # Gaussians; 0 draws all
_BUTTON = "Effect of a drag in the 3D view. Shift and the button that turns move the camera sideways"


@dataclass(frozen=True)
class Preference:
    """One preference.

    key       key in the settings
    group     title of its group
    words     its effect, for the tooltip and the search
    default   a key of `choices`, a bool, or a number from `low` to `high` in steps of `step`
    choices   value -> label
    unit      suffix of a number
    nothing   text that replaces the lowest number
    """

    key: str
    group: str
    title: str
    words: str
    default: Value
    choices: Mapping[str, str] = field(default_factory=dict)
    low: float = 0.0
    high: float = 1.0
    step: float = 1.0
    unit: str = ""
    nothing: str = ""

    @property
    def decimals(self) -> int:
        return 0 if self.step >= 1 else 2 if self.step < 0.1 else 1

    def fitting(self, stored: object) -> Value:
        """Converts `stored` to a value of this preference. Returns the default if `stored` is not valid."""
        if self.choices:
            return str(stored) if str(stored) in self.choices else self.default
        if isinstance(self.default, bool):
            return str(stored).lower() == "true" if str(stored).lower() in ("true", "false") else self.default
        try:
            number = float(str(stored))
        except ValueError:
            return self.default
        return number if self.low <= number <= self.high else self.default


PREFERENCES = (
    Preference(
        "theme", "Appearance", "Theme", "Dark, light, or the theme of the desktop", "dark",
        {"dark": "dark", "light": "light", "system": "like the desktop"},
    ),
    Preference(
        "units", "Appearance", "Lengths",
        "Unit of every displayed length: on the map, in tables, and while measuring. Lengths that you enter and "
        "command options are always in meters",
        "metres", {"metres": "meters", "feet": "feet"},
    ),
    Preference("mouse/left", "Mouse and flying", "Left button", _BUTTON, "turn", MOTIONS),
    Preference("mouse/middle", "Mouse and flying", "Middle button", _BUTTON, "shift", MOTIONS),
    Preference("mouse/right", "Mouse and flying", "Right button", _BUTTON, "look", MOTIONS),
    Preference(
        "mouse/upside_down", "Mouse and flying", "Invert up and down",
        "Dragging down makes the camera look up, like the stick of an aircraft", False,
    ),
    Preference(
        "mouse/backwards", "Mouse and flying", "Invert the wheel", "Reverses the direction that moves closer", False
    ),
    Preference(
        "mouse/turning", "Mouse and flying", "Speed of turning", "How far a drag turns the view",
        1.0, {}, 0.2, 5.0, 0.1, " ×",
    ),
    Preference(
        "mouse/rolling", "Mouse and flying", "Speed of the wheel", "How far one notch of the wheel moves the camera",
        1.0, {}, 0.2, 5.0, 0.1, " ×",
    ),
    Preference(
        "mouse/flying", "Mouse and flying", "Speed of flying", "Speed with the flight keys; Shift triples it",
        2.0, {}, 0.1, 50.0, 0.1, " m/s",
    ),
    Preference(
        "autosave_minutes", "Editing", "Save automatically",
        "Time from the first unsaved edit until the graph is written to the project or its file. Edits survive a "
        "crash in any case",
        0.0, {}, 0, 120, 1, " min", "never",
    ),
    Preference(
        "renderer", "Drawing and memory", "Renderer", "Renderer of color views: automatic uses the faster one",
        AUTOMATIC, {AUTOMATIC: "automatic", CPU: "CPU", OPENGL: "OpenGL"},
    ),
    Preference(
        "splat_budget", "Drawing and memory", "Displayed Gaussians",
        "Draws only the Gaussians that cover most of the image, for a computer that is too slow to draw all",
        "0", {str(n): f"{n:,} at most".replace(",", "\u202f") if n else "all" for n in BUDGETS},
    ),
    Preference(
        "memory_gib", "Drawing and memory", "Memory for models",
        "Memory that the trained models of a project may use at once. Other models are loaded when the camera comes "
        "near them",
        0.0, {}, 0, 1024, 0.5, " GiB", "automatic",
    ),
    Preference(
        "job_threads", "Jobs", "Threads of jobs",
        "Number of cores that a new job may use; fewer cores keep the computer responsive",
        0.0, {}, 0, cores(), 1, "", "all cores",
    ),
)  # fmt: skip
OF = {preference.key: preference for preference in PREFERENCES}


class Preferences(QObject):
    """Reads and stores the preferences. changed(str): the value of this key changed."""

    changed = Signal(str)

    def __init__(self, settings: QSettings, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._settings = settings

    def __getitem__(self, key: str) -> Value:
        """The current value of a preference. Raises KeyError if the table has no such key."""
        preference = OF[key]
        return preference.fitting(self._settings.value(key, preference.default))

    def number(self, key: str) -> float:
        """The current value of a numeric preference. Raises KeyError if the table has no such key."""
        return float(self[key])

    def set(self, key: str, value: Value) -> None:
        """Stores a value; an invalid value becomes the default. Raises KeyError if the table has no such key."""
        before, wanted = self[key], OF[key].fitting(value)
        self._settings.setValue(key, wanted)
        if wanted != before:
            self.changed.emit(key)

    def reset(self) -> None:
        """Restores the defaults of all preferences."""
        for preference in PREFERENCES:
            self.set(preference.key, preference.default)


def memory_budget(preferences: Preferences) -> int | None:
    """The memory for trained models in bytes; None if it is automatic."""
    return round(preferences.number("memory_gib") * 2**30) or None


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
        """`fly` receives the flight keys in the form that `ControlSettings` uses."""
        super().__init__(parent)
        self._table, self._settings, self._fly = table, settings, fly
        self._flights = {id: flight.key for id, flight in FLIGHTS.items()}
        commands = (
            KeyRow(e.id, e.text.replace("&", "").rstrip("…"), e.menu.replace("&", ""), _key_text(e.shortcut))
            for e in table.entries
        )
        flights = (KeyRow(id, flight.title, "3D view", flight.key) for id, flight in FLIGHTS.items())
        self.rows: tuple[KeyRow, ...] = (*commands, *flights, *FIXED)
        self._of = {row.id: row for row in self.rows if row.id}
        for id in self._of:
            stored = settings.value(_PREFIX + id)
            if stored is not None and not self._why_not(id, str(stored)):
                self._bind_keys(id, _key_text(str(stored)))
        self._fly(flight_directions(self._flights))

    def keys(self, row: KeyRow) -> str:
        """The current keys of a row, or "" if it has none."""
        if not row.id:
            return row.default
        return self._flights[row.id] if row.id in FLIGHTS else self._table.keys(row.id)

    def bind(self, id: str, keys: str) -> str:
        """Sets the keys of a command or flight; "" removes them. Returns "" or the reason why the keys are refused."""
        reason, keys = self._why_not(id, keys), _key_text(keys)
        if reason:
            return reason
        if keys == self._of[id].default:
            self._settings.remove(_PREFIX + id)
        else:
            self._settings.setValue(_PREFIX + id, keys)
        self._bind_keys(id, keys)
        self._fly(flight_directions(self._flights))
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
        if id in FLIGHTS and keys and not flight_directions({id: keys}):
            return "A flight key must be a single letter, digit, or named key, without Ctrl, Alt, or Shift."
        if keys and QKeySequence(keys).isEmpty():
            return f"{keys} is not a key."
        return ""

    def _bind_keys(self, id: str, keys: str) -> None:
        if id in FLIGHTS:
            self._flights[id] = keys
        else:
            self._table.bind(id, keys)


def _key_text(keys: str) -> str:
    return QKeySequence(keys).toString()
