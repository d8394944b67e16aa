"""What a user sets once for all projects: a table, and the values in the settings of the window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from PySide6.QtCore import QObject, QSettings, Signal

from app.drawing.renderer_choice import AUTOMATIC, CPU, OPENGL
from app.views.hands import MOTIONS
from nvsim.kernel_threads import cores

Value = str | bool | float
BUDGETS = (0, 400_000, 200_000, 100_000, 50_000)  # Gaussians; 0 for all
_BUTTON = "Of a drag in the 3D view. Shift with the button that turns moves sideways"


@dataclass(frozen=True)
class Preference:
    """key       in the settings
    group     under which it stands
    words     what it does, for the tool tip and the search
    default   a text of `choices`, a switch, or a number from `low` to `high` in steps of `step`
    choices   value -> words
    unit      behind a number
    nothing   in place of the lowest number
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
        """`stored` as a value of its type; the default where it is none, because the settings may hold anything."""
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
        "theme", "Look", "Theme", "Dark, light, or as the desktop has it", "dark",
        {"dark": "dark", "light": "light", "system": "as the desktop"},
    ),
    Preference(
        "units", "Look", "Lengths",
        "The unit of every length that is shown: on the map, in tables, while measuring. What is entered, and the "
        "options of commands, stay in metres",
        "metres", {"metres": "metres", "feet": "feet"},
    ),
    Preference("mouse/left", "Mouse and flying", "Left button", _BUTTON, "turn", MOTIONS),
    Preference("mouse/middle", "Mouse and flying", "Middle button", _BUTTON, "shift", MOTIONS),
    Preference("mouse/right", "Mouse and flying", "Right button", _BUTTON, "look", MOTIONS),
    Preference(
        "mouse/upside_down", "Mouse and flying", "Invert up and down",
        "Dragging down looks up, as with the stick of an aircraft", False,
    ),
    Preference(
        "mouse/backwards", "Mouse and flying", "Invert the wheel", "The wheel comes nearer the other way round", False
    ),
    Preference(
        "mouse/turning", "Mouse and flying", "Speed of turning", "How far a drag turns the view",
        1.0, {}, 0.2, 5.0, 0.1, " ×",
    ),
    Preference(
        "mouse/rolling", "Mouse and flying", "Speed of the wheel", "How far a notch of the wheel goes",
        1.0, {}, 0.2, 5.0, 0.1, " ×",
    ),
    Preference(
        "mouse/flying", "Mouse and flying", "Speed of flying", "By the keys; Shift is three times as fast",
        2.0, {}, 0.1, 50.0, 0.1, " m/s",
    ),
    Preference(
        "autosave_minutes", "Editing", "Save by itself",
        "Writes the graph to the project, or back to its file, so long after the first edit that is not saved. Edits "
        "survive a crash in any case",
        0.0, {}, 0, 120, 1, " min", "never",
    ),
    Preference(
        "renderer", "Drawing and memory", "Renderer", "Who draws colours: automatic times both and takes the faster",
        AUTOMATIC, {AUTOMATIC: "automatic", CPU: "CPU", OPENGL: "OpenGL"},
    ),
    Preference(
        "splat_budget", "Drawing and memory", "Gaussians drawn",
        "Those that cover most, for a machine that cannot draw all of them in time",
        "0", {str(n): f"{n:,} at most".replace(",", "\u202f") if n else "all" for n in BUDGETS},
    ),
    Preference(
        "memory_gib", "Drawing and memory", "Memory for models",
        "How much the trained models of a project may take in memory at once; the others are read again when the "
        "camera comes near",
        0.0, {}, 0, 1024, 0.5, " GiB", "as suits this machine",
    ),
    Preference(
        "job_threads", "Jobs", "Threads of jobs",
        "How many cores a job that starts from now on may use; fewer leave the machine to you",
        0.0, {}, 0, cores(), 1, "", "all cores",
    ),
)  # fmt: skip
OF = {preference.key: preference for preference in PREFERENCES}


class Preferences(QObject):
    """changed(str): the value of this key is another."""

    changed = Signal(str)

    def __init__(self, settings: QSettings, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._settings = settings

    def __getitem__(self, key: str) -> Value:
        """The value in use. Raises KeyError where the table has no such key."""
        preference = OF[key]
        return preference.fitting(self._settings.value(key, preference.default))

    def number(self, key: str) -> float:
        """Of a preference that is a number. Raises KeyError like []."""
        return float(self[key])

    def set(self, key: str, value: Value) -> None:
        """Remembers it; what does not fit becomes the default. Raises KeyError like []."""
        before, wanted = self[key], OF[key].fitting(value)
        self._settings.setValue(key, wanted)
        if wanted != before:
            self.changed.emit(key)

    def reset(self) -> None:
        """Everything as it was at first."""
        for preference in PREFERENCES:
            self.set(preference.key, preference.default)


def memory_budget(preferences: Preferences) -> int | None:
    """Bytes for trained models; None where the machine decides."""
    return round(preferences.number("memory_gib") * 2**30) or None
