"""Rounds the turns and distances of legs to the precision of an instruction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from nvsim.r2r.instructions.ground import Leg, wrapped

Detail = Literal["words", "clock", "degrees"]
DETAILS: tuple[Detail, ...] = ("words", "clock", "degrees")
"""Precision of an instruction, from coarse to fine. "words": turns in words, whole meters, half meters of height.
"clock": turns by the hours of a clock, half meters. "degrees": turns by tens of degrees, half meters."""
_STEPS = {"clock": 30, "degrees": 10}

TURNS = {0: "ahead", 40: "slightly right", 90: "right", 135: "sharply right", 180: "around"} | {
    -40: "slightly left",
    -90: "left",
    -135: "sharply left",
}
"""Degrees that a follower assumes for a turn in words -> the turn."""


def rounded(legs: Sequence[Leg], detail: Detail) -> list[Leg]:
    """Rounds legs to the precision that the instruction states and the follower uses."""
    return [_in_words(leg) if detail == "words" else _in_steps(leg, _STEPS[detail]) for leg in legs]


def turn_of(leg: Leg) -> str:
    """Returns the turn of a leg that was rounded to words."""
    return TURNS[_nearest(leg.turn)]


def hour_of(leg: Leg) -> int:
    """Returns the clock hour of a leg that was rounded to hours; 12 is straight ahead."""
    return round(math.degrees(leg.turn) / 30) % 12 or 12


def degrees_of(leg: Leg) -> int:
    """Returns the turn in degrees to the right, -170 to 180, of a leg that was rounded to tens of degrees."""
    return round(math.degrees(leg.turn))


def _in_words(leg: Leg) -> Leg:
    metres = leg.metres
    if metres is not None:
        metres = float(max(1, round(metres))) if leg.slope == "level" else _in_halves(metres)
    return Leg(math.radians(_nearest(leg.turn)), metres, leg.slope, leg.cues)


def _in_steps(leg: Leg, degrees: int) -> Leg:
    turn = wrapped(math.radians(degrees * round(math.degrees(leg.turn) / degrees)))
    return Leg(turn, None if leg.metres is None else _in_halves(leg.metres), leg.slope, leg.cues)


def _in_halves(metres: float) -> float:
    return max(0.5, round(2 * metres) / 2)


def _nearest(turn: float) -> int:
    return min(TURNS, key=lambda degrees: abs(wrapped(turn - math.radians(degrees))))
