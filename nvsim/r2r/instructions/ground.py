"""A graph as one who walks it feels it: which way every step leads, how far, and whether up or down."""

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
"""A step that turns by less goes on in the same leg."""


@dataclass(frozen=True)
class Step:
    """to        row of Ways
    heading   radians, None straight up or down
    metres    of the edge; of one up or down, metres of height
    """

    to: int
    heading: float | None
    metres: float
    slope: Slope


@dataclass(frozen=True)
class Leg:
    """A part of a path without a turn, on the level, up or down.

    turn     radians from where one looks to where it begins, positive to the right, in (-pi, pi]
    metres   of all its steps, of a leg up or down metres of height; None where nothing is said of them
    cues     what is seen along it: all of it, or what is said
    """

    turn: float
    metres: float | None
    slope: Slope
    cues: frozenset[Cue] = frozenset()


class Ground:
    """row     viewpoint id -> its row of Ways
    steps   of each viewpoint, by rows
    """

    def __init__(self, ways: Ways, seen: Surroundings | None = None) -> None:
        """With `seen`, what stands around, legs have cues."""
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
        """The legs of a path of two viewpoints or more, for one who looks to `heading` (radians) at its start."""
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
        """The step between two rows that an edge joins."""
        return next(step for step in self.steps[start] if step.to == stop)

    def cues(self, rows: Sequence[int]) -> frozenset[Cue]:
        """What is seen along a leg over `rows`, two or more."""
        key = tuple(rows)
        if key not in self._cues:
            last = self.step(key[-2], key[-1])
            found = frozenset(stair_cues([[step.slope for step in self.steps[row]] for row in key], last.slope))
            if self._seen is not None and last.heading is not None:
                found |= cues_along([self._ids[row] for row in key], last.heading, self._seen)
            self._cues[key] = found
        return self._cues[key]


def turned(facing: float, step: Step) -> float:
    """Radians from where one looks to where a step leads, in (-pi, pi]; 0 where it leads straight up or down."""
    return 0.0 if step.heading is None else wrapped(step.heading - facing)


def goes_on(slope: Slope, turn: float, step: Step) -> bool:
    """Whether a step belongs to the same leg as the one before it, of which the slope is given."""
    return slope == step.slope and abs(turn) < _STRAIGHT


def wrapped(angle: float) -> float:
    """The angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
