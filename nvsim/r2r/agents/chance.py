"""RANDOM, in two definitions. The same seed gives the same trajectory for an instr_id, in any file, on any machine."""

from __future__ import annotations

from random import Random

from nvsim.r2r.agents.running import Action
from nvsim.r2r.simulator import SimState
from nvsim.r2r.tasks.task import Task

_RIGHT: Action = (0, 1.0, 0.0)


class RandomAgent:
    """R2R's: turns right up to eleven times, then goes ahead five times, to the viewpoint nearest to the middle of the
    view; where there is none in view it turns right. Thirty actions at most.

    Source: Matterport3DSimulator tasks/R2R/agent.py, `RandomAgent`.
    """

    restricted = True

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed

    def begin(self, instr_id: str, task: Task) -> _Ahead:
        return _Ahead(_below(Random(f"{self._seed} {instr_id}"), 12))


class _Ahead:
    def __init__(self, turns: int) -> None:
        self._turns, self._moves, self._actions = turns, 0, 0

    def act(self, state: SimState) -> Action | None:
        if self._moves == 5 or self._actions == 30:
            return None
        self._actions += 1
        if self._turns:
            self._turns -= 1
            return _RIGHT
        if len(state.navigableLocations) < 2:
            return _RIGHT
        self._moves += 1
        return 1, 0.0, 0.0


class PaperRandomAgent:
    """The paper's, "which takes 10 random actions" (section V-C): goes ten times to any neighbour, wherever it lies."""

    restricted = False

    def __init__(self, seed: int = 0, moves: int = 10) -> None:
        self._seed, self._moves = seed, moves

    def begin(self, instr_id: str, task: Task) -> _Anywhere:
        return _Anywhere(Random(f"{self._seed} {instr_id}"), self._moves)


class _Anywhere:
    def __init__(self, random: Random, moves: int) -> None:
        self._random, self._left = random, moves

    def act(self, state: SimState) -> Action | None:
        # In the order of the file, whichever way the agent looks.
        here = state.location.ix
        places = sorted((place.ix, i) for i, place in enumerate(state.navigableLocations) if place.ix != here)
        if not self._left or not places:
            return None
        self._left -= 1
        return places[_below(self._random, len(places))][1], 0.0, 0.0


def _below(random: Random, count: int) -> int:
    """0 to `count` - 1; of all methods of Random only this one never changes between versions of Python."""
    return int(random.random() * count)
