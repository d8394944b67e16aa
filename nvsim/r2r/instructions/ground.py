"""The steps of a graph as directions, distances and slopes, without positions, and their precision in instructions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence, Set
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Literal

from nvsim.graph.paths import PathGraph
from nvsim.graph.quantities import Slope, slope_of
from nvsim.r2r.instructions.cues import Cue, cues_along, objects_around, stair_cues
from nvsim.r2r.surroundings.survey import Surroundings

_STRAIGHT = math.radians(25)
"""A step that turns by less belongs to the current leg."""
_BEND = math.radians(60)
"""A step that turns by less may be a bend within a leg."""
Detail = Literal["words", "clock", "degrees"]
DETAILS: tuple[Detail, ...] = ("words", "clock", "degrees")
"""Precision of an instruction, from coarse to fine. "words": turns in words, whole meters, half meters of height.
"clock": turns by the hours of a clock, half meters. "degrees": turns by tens of degrees, half meters."""
_STEPS = {"clock": 30, "degrees": 10}
Measure = Literal["metres", "paces", "roughly"]
"""Unit of a distance in an instruction: meters, counted paces (on stairs, steps of the stairs), or a rough word."""
PACE, RISER = 0.5, 0.17
"""Meters of a pace, and of the rise of a step of stairs."""
ROUGH = (1.0, 2.5, 5.0, 10.0)
"""Distances in meters that a follower assumes for rough words."""

TURNS = {0: "ahead", 40: "slightly right", 90: "right", 135: "sharply right", 180: "around"} | {
    -40: "slightly left",
    -90: "left",
    -135: "sharply left",
}
"""Degrees that a follower assumes for a turn in words -> the turn."""


@dataclass(frozen=True)
class Step:
    """One step along an edge.

    to        row of Ways
    heading   radians, None for a step straight up or down
    meters    length of the edge in meters; for a step up or down, the height difference
    """

    to: int
    heading: float | None
    meters: float
    slope: Slope


@dataclass(frozen=True)
class View:
    """A view at a viewpoint.

    kind     "room", "corridor", or "" if unknown
    objects  visible objects with their sides, seen in the direction of movement; the nearest first
    """

    kind: str
    objects: tuple[Cue, ...] = ()


@dataclass(frozen=True)
class Leg:
    """A part of a path without a turn, level, up or down.

    turn     radians from the previous heading to the heading of the leg, positive to the right, in (-pi, pi]
    meters   length of all steps in meters; for a leg up or down, the height difference; None if not mentioned
    cues     all cues along the leg, or those that the instruction mentions
    measure  unit in which the instruction mentions the length
    rows     rows of Ways of the viewpoints along it, () if they are unknown
    """

    turn: float
    meters: float | None
    slope: Slope
    cues: frozenset[Cue] = frozenset()
    measure: Measure = "metres"
    rows: tuple[int, ...] = field(default=(), compare=False)


class PathSteps:
    """The steps between viewpoints, by rows of Ways.

    row     viewpoint id -> row
    steps   steps from each viewpoint, by row
    """

    def __init__(self, ways: PathGraph, seen: Surroundings | None = None) -> None:
        """If `seen`, the surroundings, is given, legs have cues of objects, rooms and floors."""
        self._ids, self._seen = ways.ids, seen
        self._cues: dict[tuple[int, ...], frozenset[Cue]] = {}
        self.row = {id: i for i, id in enumerate(ways.ids)}
        self.steps: list[list[Step]] = [[] for _ in ways.ids]
        for (a, b), meters in zip(ways.ends.tolist(), ways.length.tolist()):
            for start, stop in ((a, b), (b, a)):
                x, y, z = (ways.places[stop] - ways.places[start]).tolist()
                heading = math.atan2(x, y) if math.hypot(x, y) > 1e-6 else None
                slope = slope_of(z, meters)
                self.steps[start].append(Step(stop, heading, meters if slope == "level" else abs(z), slope))

    def legs(self, rows: Sequence[int], heading: float, bends: Set[int] = frozenset()) -> list[Leg]:
        """Splits a path of two viewpoints or more, with first heading `heading` (radians), into legs.

        `bends` are the numbers of steps that belong to the current leg although they turn.
        """
        legs: list[Leg] = []
        facing, meters, begin = heading, 0.0, 0
        for i, (start, stop) in enumerate(zip(rows, rows[1:])):
            step = self.step(start, stop)
            turn = turn_before_step(facing, step)
            if legs and (i in bends or continues_leg(legs[-1].slope, turn, step)):
                turn, meters = legs.pop().turn, meters + step.meters
            else:
                meters, begin = step.meters, i
            here = tuple(rows[begin : i + 2])
            legs.append(Leg(turn, meters, step.slope, self.cues(here), rows=here))
            facing = facing if step.heading is None else step.heading
        return legs

    def legs_with_bends(self, rows: Sequence[int], heading: float) -> Iterator[list[Leg]]:
        """Yields the ways to split a path into legs, from the fewest legs, with all bends inside legs, to none."""
        steps = [self.step(*pair) for pair in zip(rows, rows[1:])]
        found = []
        for i, (one, step) in enumerate(zip(steps, steps[1:]), start=1):
            if one.heading is not None and is_bend(one.slope, turn_before_step(one.heading, step), step):
                found.append(i)
        for count in range(len(found), -1, -1):
            for bends in combinations(found, count):
                yield self.legs(rows, heading, frozenset(bends))

    def view(self, row: int, facing: float) -> View:
        """Returns the named objects that are visible from a viewpoint ahead, on the left, and on the right."""
        if self._seen is None:
            return View("")
        return View(self._seen.kinds.get(self._ids[row], ""), tuple(objects_around(self._ids[row], facing, self._seen)))

    def step(self, start: int, stop: int) -> Step:
        """Returns the step between two rows that share an edge."""
        return next(step for step in self.steps[start] if step.to == stop)

    def cues(self, rows: Sequence[int]) -> frozenset[Cue]:
        """Returns the cues of a leg over `rows` (two or more)."""
        key = tuple(rows)
        if key not in self._cues:
            last = self.step(key[-2], key[-1])
            found = frozenset(stair_cues([[step.slope for step in self.steps[row]] for row in key], last.slope))
            if self._seen is not None and last.heading is not None:
                found |= cues_along([self._ids[row] for row in key], last.heading, self._seen)
            self._cues[key] = found
        return self._cues[key]


def turn_before_step(facing: float, step: Step) -> float:
    """Returns the turn in radians, in (-pi, pi], before a step; 0 if the step leads straight up or down."""
    return 0.0 if step.heading is None else wrap_angle(step.heading - facing)


def continues_leg(slope: Slope, turn: float, step: Step) -> bool:
    """Whether a step continues the leg of the previous step, which has slope `slope`."""
    return slope == step.slope and abs(turn) < _STRAIGHT


def is_bend(slope: Slope, turn: float, step: Step) -> bool:
    """Whether a step is a bend that a leg with slope `slope` may follow."""
    return slope == step.slope and _STRAIGHT <= abs(turn) <= _BEND


def wrap_angle(angle: float) -> float:
    """Wraps an angle to (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)


def round_legs(legs: Sequence[Leg], detail: Detail) -> list[Leg]:
    """Rounds legs to the precision that the instruction states and the follower uses."""
    return [_in_words(leg) if detail == "words" else _in_steps(leg, _STEPS[detail]) for leg in legs]


def rounded_turn(leg: Leg) -> str:
    """Returns the turn of a leg that was rounded to words."""
    return TURNS[_nearest(leg.turn)]


def clock_hour(leg: Leg) -> int:
    """Returns the clock hour of a leg that was rounded to hours; 12 is straight ahead."""
    return round(math.degrees(leg.turn) / 30) % 12 or 12


def degrees_of(leg: Leg) -> int:
    """Returns the turn in degrees to the right, -170 to 180, of a leg that was rounded to tens of degrees."""
    return round(math.degrees(leg.turn))


def _in_words(leg: Leg) -> Leg:
    turn = math.radians(_nearest(leg.turn))
    if leg.meters is not None and leg.measure == "metres" and leg.slope == "level":
        return replace(leg, turn=turn, meters=float(max(1, round(leg.meters))))
    return replace(leg, turn=turn, meters=_in_units(leg))


def _in_steps(leg: Leg, degrees: int) -> Leg:
    return replace(
        leg, turn=wrap_angle(math.radians(degrees * round(math.degrees(leg.turn) / degrees))), meters=_in_units(leg)
    )


def _in_units(leg: Leg) -> float | None:
    """Rounds the length of a leg to its measure; meters to halves."""
    if leg.meters is None:
        return None
    if leg.measure == "roughly":
        return min(ROUGH, key=lambda meters: abs(math.log(meters / max(leg.meters or 0, 0.1))))
    if leg.measure == "paces":
        unit = PACE if leg.slope == "level" else RISER
        return max(1, round(leg.meters / unit)) * unit
    return _in_halves(leg.meters)


def _in_halves(meters: float) -> float:
    return max(0.5, round(2 * meters) / 2)


def _nearest(turn: float) -> int:
    return min(TURNS, key=lambda degrees: abs(wrap_angle(turn - math.radians(degrees))))
