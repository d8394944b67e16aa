"""Two random agents. The seed and the instr_id determine the trajectory on every machine."""

from __future__ import annotations

from random import Random

from nvsim.r2r.agents.running import Action
from nvsim.r2r.simulator import SimState
from nvsim.r2r.tasks.task import Task

_RIGHT: Action = (0, 1.0, 0.0)


class RandomAgent:
    """The random agent of the R2R code: turns right 0 to 11 times, then moves 5 times.

    Each move goes to the viewpoint nearest to the view center. If the view shows none, the agent turns right. It stops
    after 30 actions at most.

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
    """The random agent of the R2R paper, "which takes 10 random actions" (section V-C).

    It moves ten times to a random neighbor, in any direction.
    """

    restricted = False

    def __init__(self, seed: int = 0, moves: int = 10) -> None:
        self._seed, self._moves = seed, moves

    def begin(self, instr_id: str, task: Task) -> _Anywhere:
        return _Anywhere(Random(f"{self._seed} {instr_id}"), self._moves)


class _Anywhere:
    def __init__(self, random: Random, moves: int) -> None:
        self._random, self._left = random, moves

    def act(self, state: SimState) -> Action | None:
        # Sorts by the order in the file, so that the choice does not depend on the heading.
        here = state.location.ix
        places = sorted((place.ix, i) for i, place in enumerate(state.navigableLocations) if place.ix != here)
        if not self._left or not places:
            return None
        self._left -= 1
        return places[_below(self._random, len(places))][1], 0.0, 0.0


def _below(random: Random, count: int) -> int:
    """A random integer from 0 to `count` - 1. Only `Random.random()` gives equal results in all Python versions."""
    return int(random.random() * count)
