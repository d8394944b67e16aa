"""The agents without a network, by the names that the commands use: two random agents and the shortest path.

The seed and the instr_id determine the trajectory of a random agent on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cached_property
from random import Random
from typing import Literal

from nvsim.errors import InputError
from nvsim.graph.paths import PathGraph
from nvsim.graph.types import NavGraph
from nvsim.r2r.agents.benchmark import Action, Agent
from nvsim.r2r.simulator import SimState
from nvsim.r2r.tasks.shortest import ShortestPaths, ShortestPathTree
from nvsim.r2r.tasks.task import Task

_CLOSE = math.radians(30)  # moves without another turn if the viewpoint is closer to the view center than this angle
_LEFT, _RIGHT, _DOWN, _UP = (0, -1.0, 0.0), (0, 1.0, 0.0), (0, 0.0, -1.0), (0, 0.0, 1.0)
_MOST_TURNS = 40  # turns at one viewpoint: all 36 views and a margin
Name = Literal["shortest", "random", "random-paper"]


class ShortestAgent:
    """Follows the shortest path to the goal and turns to each viewpoint before moving to it.

    graphs   scan id -> graph

    Source: Matterport3DSimulator tasks/R2R/env.py, `_shortest_path_action`.
    """

    restricted = True

    def __init__(self, graphs: Mapping[str, NavGraph]) -> None:
        self._scans = {scan: _Scan(graph) for scan, graph in graphs.items()}

    def begin(self, instr_id: str, task: Task) -> _Walk:
        return _Walk(self._scans[task.scan], task.path[-1])


class _Scan:
    def __init__(self, graph: NavGraph) -> None:
        self.graph = graph
        self._trees: dict[str, ShortestPathTree] = {}

    @cached_property
    def path_graph(self) -> PathGraph:
        return PathGraph.of(self.graph)

    @cached_property
    def row(self) -> dict[str, int]:
        return {id: i for i, id in enumerate(self.path_graph.ids)}

    @cached_property
    def shortest(self) -> ShortestPaths:
        return ShortestPaths(self.path_graph)

    def next_to(self, goal: str, here: str) -> str:
        """Returns the viewpoint after `here` on the shortest path to `goal`."""
        if goal not in self._trees:
            self._trees[goal] = self.shortest.tree(self.row[goal])
        return self.path_graph.ids[self._trees[goal].before[self.row[here]]]


class _Walk:
    def __init__(self, scan: _Scan, goal: str) -> None:
        self._scan, self._goal = scan, goal
        self._at, self._turns = "", 0

    def act(self, state: SimState) -> Action | None:
        here = state.location.viewpointId
        if here == self._goal:
            return None
        there = self._scan.next_to(self._goal, here)
        self._turns = self._turns + 1 if here == self._at else 0
        self._at = here
        if self._turns > _MOST_TURNS:
            raise InputError(
                f"No view from {here} in the scan {self._scan.graph.scan} leads to {there}, which is straight above or "
                "below; move one of them aside with `nvsim graph edit`."
            )
        row = state.viewIndex // 12
        for i, place in enumerate(state.navigableLocations):
            if place.viewpointId == there:
                if abs(place.rel_heading) > _CLOSE:
                    return _RIGHT if place.rel_heading > 0 else _LEFT
                if place.rel_elevation > _CLOSE and row < 2:
                    return _UP
                if place.rel_elevation < -_CLOSE and row > 0:
                    return _DOWN
                return i, 0.0, 0.0
        if row != 1:
            return _UP if row == 0 else _DOWN
        return self._turn_to(there, state)

    def _turn_to(self, there: str, state: SimState) -> Action:
        """Returns the turn in the shorter direction."""
        x, y, _ = self._scan.graph.viewpoints[there].position
        heading = math.atan2(x - state.location.x, y - state.location.y)
        return _RIGHT if (heading - state.heading) % (2 * math.pi) < math.pi else _LEFT


class RandomAgent:
    """The random agent of the R2R code: turns right 0 to 11 times, then moves 5 times.

    Each move goes to the viewpoint nearest to the view center. If the view shows none, the agent turns right. It stops
    after 30 actions at most.

    Source: Matterport3DSimulator tasks/R2R/agent.py, `RandomAgent`.
    """

    restricted = True

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed

    def begin(self, instr_id: str, task: Task) -> _StraightWalk:
        return _StraightWalk(_random_below(Random(f"{self._seed} {instr_id}"), 12))


class _StraightWalk:
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

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed

    def begin(self, instr_id: str, task: Task) -> _RandomWalk:
        return _RandomWalk(Random(f"{self._seed} {instr_id}"))


class _RandomWalk:
    def __init__(self, random: Random) -> None:
        self._random, self._left = random, 10  # moves

    def act(self, state: SimState) -> Action | None:
        # Sorts by the order in the file, so that the choice does not depend on the heading.
        here = state.location.ix
        places = sorted((place.ix, i) for i, place in enumerate(state.navigableLocations) if place.ix != here)
        if not self._left or not places:
            return None
        self._left -= 1
        return places[_random_below(self._random, len(places))][1], 0.0, 0.0


def _random_below(random: Random, count: int) -> int:
    """A random integer from 0 to `count` - 1. Only `Random.random()` gives equal results in all Python versions."""
    return int(random.random() * count)


def agent_of(name: Name, graphs: Mapping[str, NavGraph], seed: int) -> Agent:
    """Returns the agent with this name.

    graphs   scan id -> graph
    """
    if name == "shortest":
        return ShortestAgent(graphs)
    return RandomAgent(seed) if name == "random" else PaperRandomAgent(seed)
