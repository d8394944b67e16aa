"""What can be said of a leg: turns and metres as rough as words are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from nvsim.r2r.instructions.ground import Leg, wrapped

Detail = Literal["words", "clock", "degrees"]
DETAILS: tuple[Detail, ...] = ("words", "clock", "degrees")
"""How fine an instruction is: turns in words and whole metres, of height half ones; turns by the hours of a clock and
half metres; turns by tens of degrees and half metres."""
_STEPS = {"clock": 30, "degrees": 10}

TURNS = {0: "ahead", 40: "slightly right", 90: "right", 135: "sharply right", 180: "around"} | {
    -40: "slightly left",
    -90: "left",
    -135: "sharply left",
}
"""Degrees that a turn in words is taken for -> the turn."""


def rounded(legs: Sequence[Leg], detail: Detail) -> list[Leg]:
    """The legs as they are said: what a follower has of them."""
    return [_in_words(leg) if detail == "words" else _in_steps(leg, _STEPS[detail]) for leg in legs]


def turn_of(leg: Leg) -> str:
    """The turn of a leg that was rounded to words."""
    return TURNS[_nearest(leg.turn)]


def hour_of(leg: Leg) -> int:
    """The hour of the clock, 12 straight ahead, of a leg that was rounded to it."""
    return round(math.degrees(leg.turn) / 30) % 12 or 12


def degrees_of(leg: Leg) -> int:
    """Degrees to the right, -170 to 180, of a leg that was rounded to tens of them."""
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
