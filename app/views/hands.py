"""How a user's hands move the eye of the 3D view: which button does what, how far, and which keys fly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from PySide6.QtCore import Qt

MOTIONS = {"turn": "turn around the point ahead", "shift": "move sideways", "look": "look around from where you stand"}


@dataclass(frozen=True)
class Flight:
    """What a key does: in words, the key at first, and the way forward, right and up."""

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
    """Qt's number of the key -> its way, from name of the flight -> text of the key; without those that have none."""
    named = {name: getattr(Qt.Key, f"Key_{key}", None) for name, key in keys.items()}
    return {int(key): FLIGHTS[name].way for name, key in named.items() if key is not None}


@dataclass(frozen=True)
class Hands:
    """left, middle, right   what a drag with the button does, of MOTIONS; Shift makes turning a move sideways
    upside_down              dragging down looks up
    backwards                the wheel comes nearer the other way round
    turning, rolling         how far a drag and a notch of the wheel go, in shares of the usual
    keys                     Qt's number of a key -> the way it flies, forward, right and up
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
        """What a drag with these buttons does, "" for nothing; of several the right one counts, then the middle one."""
        for button, motion in (
            (Qt.MouseButton.RightButton, self.right),
            (Qt.MouseButton.MiddleButton, self.middle),
            (Qt.MouseButton.LeftButton, self.left),
        ):
            if buttons & button:
                return "shift" if shift and motion == "turn" else motion
        return ""
