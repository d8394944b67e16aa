"""The preferences for all projects: a table of them, and their values in the settings of the window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from PySide6.QtCore import QObject, QSettings, Signal

from app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL
from app.views.hands import MOTIONS
from nvsim.kernel_threads import cores

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
