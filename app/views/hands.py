"""The mouse and keyboard settings of the 3D view: actions of the mouse buttons, sensitivity, and keys for flying."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from PySide6.QtCore import Qt

MOTIONS = {"turn": "orbit around the point ahead", "shift": "move sideways", "look": "look around in place"}


@dataclass(frozen=True)
class Flight:
    """A motion that a key controls: title, default key, and direction (forward, right, up)."""

    title: str
    key: str
    way: tuple[int, int, int]


FLIGHTS = {
    "fly_forward": Flight("Fly forward", "W", (1, 0, 0)),
    "fly_back": Flight("Fly back", "S", (-1, 0, 0)),
    "fly_right": Flight("Fly right", "D", (0, 1, 0)),
    "fly_left": Flight("Fly left", "A", (0, -1, 0)),
    "fly_up": Flight("Fly up", "E", (0, 0, 1)),
    "fly_down": Flight("Fly down", "Q", (0, 0, -1)),
}


def flying(keys: Mapping[str, str]) -> dict[int, tuple[int, int, int]]:
    """Converts a mapping from names in FLIGHTS to key texts into a mapping from Qt key codes to directions. Unknown
    keys are omitted."""
    named = {name: getattr(Qt.Key, f"Key_{key}", None) for name, key in keys.items()}
    return {int(key): FLIGHTS[name].way for name, key in named.items() if key is not None}


@dataclass(frozen=True)
class Hands:
    """The mouse and keyboard settings of the 3D view.

    left, middle, right   motion of a drag with the button, a key in MOTIONS; Shift changes "turn" to "shift"
    upside_down           whether dragging down looks up
    backwards             whether the direction of the wheel is reversed
    turning, rolling      sensitivity of dragging and of the wheel; 1 is the default
    keys                  Qt key code -> flying direction (forward, right, up)
    """

    left: str = "turn"
    middle: str = "shift"
    right: str = "look"
    upside_down: bool = False
    backwards: bool = False
    turning: float = 1.0
    rolling: float = 1.0
    keys: Mapping[int, tuple[int, int, int]] = field(
        default_factory=lambda: flying({name: flight.key for name, flight in FLIGHTS.items()})
    )

    def motion(self, buttons: Qt.MouseButton, shift: bool) -> str:
        """The motion of a drag with these buttons, "" for none. Of several buttons, the right one takes precedence,
        then the middle one."""
        for button, motion in (
            (Qt.MouseButton.RightButton, self.right),
            (Qt.MouseButton.MiddleButton, self.middle),
            (Qt.MouseButton.LeftButton, self.left),
        ):
            if buttons & button:
                return "shift" if shift and motion == "turn" else motion
        return ""
