"""A follower of instructions: it knows the graph, where it starts and looks, and what was said; not the path."""

from __future__ import annotations

import math
from collections.abc import Sequence

from nvsim.r2r.instructions.ground import Ground, Leg, Step, goes_on, turned, wrapped

_METRE = 0.5  # metres that a distance is off, and
_ANGLE = math.radians(22.5)  # radians that a turn is off, to cost 1 (squared)
_FARTHEST_TURN = math.radians(60)  # from what was said
_UNSEEN = 2.0  # what it costs that something is not there that was said to be
_LONGEST = 15.0  # metres of a leg of which no metres were said
_ALIKE = 1e-9
_MOST = 200_000  # steps that are tried


def follow(ground: Ground, start: int, heading: float, said: Sequence[Leg]) -> list[int] | None:
    """The rows of the path from `start` that fits best what was said, for one who looks to `heading` (radians) there.
    None where no path fits at all, two fit as well, or there are too many to weigh them all.

    The squares of what turns and distances are off are summed, and so much for each thing said that is not there;
    slopes must be as they were said."""
    search = _Search(ground, said)
    search.begin([start], heading, 0, 0.0)
    return None if search.tied or search.tried > _MOST else search.best


class _Search:
    """Depth first, over legs in order; a branch ends where it costs more than the best path so far."""

    def __init__(self, ground: Ground, said: Sequence[Leg]) -> None:
        self.ground, self.said = ground, said
        self.best: list[int] | None = None
        self.least = math.inf
        self.tied = False
        self.tried = 0

    def begin(self, path: list[int], facing: float, k: int, cost: float) -> None:
        """All first steps of the k-th leg."""
        said = self.said[k]
        for step in self._new_steps(path):
            off = wrapped(turned(facing, step) - said.turn)
            if step.slope == said.slope and abs(off) <= _FARTHEST_TURN:
                after = _facing(facing, step)
                self._walk([*path, step.to], len(path) - 1, after, k, step.metres, cost + (off / _ANGLE) ** 2)

    def _walk(self, path: list[int], first: int, facing: float, k: int, walked: float, cost: float) -> None:
        """Goes on with the k-th leg, or ends it here, `walked` metres from where it began, at path[first]."""
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
