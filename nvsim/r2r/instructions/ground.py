"""The steps of a graph as directions, distances and slopes, without positions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from nvsim.graph.slopes import Slope, slope_of
from nvsim.graph.ways import Ways
from nvsim.r2r.instructions.cues import Cue, cues_along
from nvsim.r2r.instructions.stairs import stair_cues
from nvsim.r2r.surroundings.survey import Surroundings

_STRAIGHT = math.radians(25)
"""A step that turns by less belongs to the current leg."""


@dataclass(frozen=True)
class Step:
    """One step along an edge.

    to        row of Ways
    heading   radians, None for a step straight up or down
    metres    length of the edge in meters; for a step up or down, the height difference
    """

    to: int
    heading: float | None
    metres: float
    slope: Slope


@dataclass(frozen=True)
class Leg:
    """A part of a path without a turn, level, up or down.

    turn     radians from the previous heading to the heading of the leg, positive to the right, in (-pi, pi]
    metres   length of all steps in meters; for a leg up or down, the height difference; None if not mentioned
    cues     all cues along the leg, or those that the instruction mentions
    """

    turn: float
    metres: float | None
    slope: Slope
    cues: frozenset[Cue] = frozenset()


class Ground:
    """The steps between viewpoints, by rows of Ways.

    row     viewpoint id -> row
    steps   steps from each viewpoint, by row
    """

    def __init__(self, ways: Ways, seen: Surroundings | None = None) -> None:
        """If `seen`, the surroundings, is given, legs have cues of objects, rooms and floors."""
        self._ids, self._seen = ways.ids, seen
        self._cues: dict[tuple[int, ...], frozenset[Cue]] = {}
        self.row = {id: i for i, id in enumerate(ways.ids)}
        self.steps: list[list[Step]] = [[] for _ in ways.ids]
        for (a, b), metres in zip(ways.ends.tolist(), ways.length.tolist()):
            for start, stop in ((a, b), (b, a)):
                x, y, z = (ways.places[stop] - ways.places[start]).tolist()
                heading = math.atan2(x, y) if math.hypot(x, y) > 1e-6 else None
                slope = slope_of(z, metres)
                self.steps[start].append(Step(stop, heading, metres if slope == "level" else abs(z), slope))

    def legs(self, rows: Sequence[int], heading: float) -> list[Leg]:
        """Splits a path of two viewpoints or more, with first heading `heading` (radians), into legs."""
        legs: list[Leg] = []
        facing, metres, begin = heading, 0.0, 0
        for i, (start, stop) in enumerate(zip(rows, rows[1:])):
            step = self.step(start, stop)
            turn = turned(facing, step)
            if legs and goes_on(legs[-1].slope, turn, step):
                turn, metres = legs.pop().turn, metres + step.metres
            else:
                metres, begin = step.metres, i
            legs.append(Leg(turn, metres, step.slope, self.cues(rows[begin : i + 2])))
            facing = facing if step.heading is None else step.heading
        return legs

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


def turned(facing: float, step: Step) -> float:
    """Returns the turn in radians, in (-pi, pi], before a step; 0 if the step leads straight up or down."""
    return 0.0 if step.heading is None else wrapped(step.heading - facing)


def goes_on(slope: Slope, turn: float, step: Step) -> bool:
    """Whether a step continues the leg of the previous step, which has slope `slope`."""
    return slope == step.slope and abs(turn) < _STRAIGHT


def wrapped(angle: float) -> float:
    """Wraps an angle to (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
