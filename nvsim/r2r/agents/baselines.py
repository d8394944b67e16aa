"""The agents without a network, by the names that the commands use: two random agents and the shortest path.

The seed and the instr_id determine the trajectory of a random agent on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
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


def agent_of(name: Name, graphs: Mapping[str, NavGraph], seed: int) -> Agent:
    """Returns the agent with this name.

    graphs   scan id -> graph
    """
    if name == "shortest":
        return shortest_agent(graphs)
    return random_agent(seed) if name == "random" else paper_random_agent(seed)


def shortest_agent(graphs: Mapping[str, NavGraph]) -> Agent:
    """Returns an agent that follows the shortest path to the goal and turns to each viewpoint before moving to it.

    graphs   scan id -> graph

    Source: Matterport3DSimulator tasks/R2R/env.py, `_shortest_path_action`.
    """
    scans = {scan: _Scan(graph) for scan, graph in graphs.items()}
    return Agent(True, lambda instr_id, task, state: _follow_shortest_path(scans[task.scan], task.path[-1], state))


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


def _follow_shortest_path(scan: _Scan, goal: str, state: SimState) -> Iterator[Action]:
    at, turns = "", 0
    while (here := state.location.viewpointId) != goal:
        there = scan.next_to(goal, here)
        turns = turns + 1 if here == at else 0
        at = here
        if turns > _MOST_TURNS:
            raise InputError(
                f"No view from {here} in the scan {scan.graph.scan} leads to {there}, which is straight above or "
                "below; move one of them aside with `nvsim graph edit`."
            )
        yield _action_toward(there, scan.graph, state)


def _action_toward(there: str, graph: NavGraph, state: SimState) -> Action:
    """Returns the move to the viewpoint `there`, or a turn toward it."""
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
    x, y, _ = graph.viewpoints[there].position
    heading = math.atan2(x - state.location.x, y - state.location.y)
    return _RIGHT if (heading - state.heading) % (2 * math.pi) < math.pi else _LEFT


def random_agent(seed: int = 0) -> Agent:
    """Returns the random agent of the R2R code: it turns right 0 to 11 times, then moves 5 times.

    Each move goes to the viewpoint nearest to the view center. If the view shows none, the agent turns right. It stops
    after 30 actions at most.

    Source: Matterport3DSimulator tasks/R2R/agent.py, `RandomAgent`.
    """

    def episode(instr_id: str, task: Task, state: SimState) -> Iterator[Action]:
        turns, moves = _random_below(Random(f"{seed} {instr_id}"), 12), 0
        for actions in range(30):
            if moves == 5:
                return
            if actions < turns or len(state.navigableLocations) < 2:
                yield _RIGHT
            else:
                moves += 1
                yield 1, 0.0, 0.0

    return Agent(True, episode)


def paper_random_agent(seed: int = 0) -> Agent:
    """Returns the random agent of the R2R paper, "which takes 10 random actions" (section V-C).

    It moves ten times to a random neighbor, in any direction.
    """

    def episode(instr_id: str, task: Task, state: SimState) -> Iterator[Action]:
        random = Random(f"{seed} {instr_id}")
        for _ in range(10):
            # Sorts by the order in the file, so that the choice does not depend on the heading.
            here = state.location.ix
            places = sorted((place.ix, i) for i, place in enumerate(state.navigableLocations) if place.ix != here)
            if not places:
                return
            yield places[_random_below(random, len(places))][1], 0.0, 0.0

    return Agent(False, episode)


def _random_below(random: Random, count: int) -> int:
    """A random integer from 0 to `count` - 1. Only `Random.random()` gives equal results in all Python versions."""
    return int(random.random() * count)
