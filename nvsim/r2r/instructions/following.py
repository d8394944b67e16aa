"""A follower of instructions. It knows the graph, the start, the first heading, and the instruction, not the path."""

from __future__ import annotations

import math
from collections.abc import Sequence

from nvsim.r2r.instructions.ground import Ground, Leg, Step, goes_on, turned, wrapped

_METRE = 0.5  # distance error in meters that costs 1 (squared)
_ANGLE = math.radians(22.5)  # turn error in radians that costs 1 (squared)
_FARTHEST_TURN = math.radians(60)  # largest turn error
_UNSEEN = 2.0  # cost of a mentioned cue that is missing
_LONGEST = 15.0  # largest length in meters of a leg without a stated distance
_ALIKE = 1e-9
_MOST = 200_000  # largest number of steps tried


def follow(ground: Ground, start: int, heading: float, said: Sequence[Leg]) -> list[int] | None:
    """Finds the path from row `start` with first heading `heading` (radians) that fits the legs best.

    The cost is the sum of the squared errors of turns and distances, plus a fixed cost for each missing cue. Slopes
    must match. Returns the rows of the path, or None if no path fits, two paths fit equally, or the search is too
    large.
    """
    search = _Search(ground, said)
    search.begin([start], heading, 0, 0.0)
    return None if search.tied or search.tried > _MOST else search.best


class _Search:
    """Depth-first search over the legs in order. A branch ends if it costs more than the best path so far."""

    def __init__(self, ground: Ground, said: Sequence[Leg]) -> None:
        self.ground, self.said = ground, said
        self.best: list[int] | None = None
        self.least = math.inf
        self.tied = False
        self.tried = 0

    def begin(self, path: list[int], facing: float, k: int, cost: float) -> None:
        """Tries all first steps of the k-th leg."""
        said = self.said[k]
        for step in self._new_steps(path):
            off = wrapped(turned(facing, step) - said.turn)
            if step.slope == said.slope and abs(off) <= _FARTHEST_TURN:
                after = _facing(facing, step)
                self._walk([*path, step.to], len(path) - 1, after, k, step.metres, cost + (off / _ANGLE) ** 2)

    def _walk(self, path: list[int], first: int, facing: float, k: int, walked: float, cost: float) -> None:
        """Continues the k-th leg or ends it here. The leg began at path[first], `walked` meters before."""
        self.tried += 1
        said = self.said[k]
        slack = 0.0 if said.metres is None else 1.0 + 0.2 * said.metres
        least, most = (0.0, _LONGEST) if said.metres is None else (said.metres - slack, said.metres + slack)
        if walked > most or cost > self.least + _ALIKE or self.tried > _MOST:
            return
        if walked >= least:
            here = cost if said.metres is None else cost + ((walked - said.metres) / _METRE) ** 2
            if said.cues and here <= self.least + _ALIKE:
                here += _UNSEEN * len(said.cues - self.ground.cues(path[first:]))
            if k + 1 < len(self.said):
                self.begin(path, facing, k + 1, here)
            else:
                self._end(path, here)
        for step in self._new_steps(path):
            if goes_on(said.slope, turned(facing, step), step):
                self._walk([*path, step.to], first, _facing(facing, step), k, walked + step.metres, cost)

    def _end(self, path: list[int], cost: float) -> None:
        if cost < self.least - _ALIKE:
            self.best, self.least, self.tied = path, cost, False
        elif cost <= self.least + _ALIKE and path != self.best:
            self.tied = True

    def _new_steps(self, path: list[int]) -> list[Step]:
        return [step for step in self.ground.steps[path[-1]] if step.to not in path]


def _facing(before: float, step: Step) -> float:
    return before if step.heading is None else step.heading
