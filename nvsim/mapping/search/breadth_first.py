"""The breadth-first search of the paper's Algorithm 1, with checked merges and corridors that must be free in both
directions."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Evidence, Viewpoint
from nvsim.mapping.corridor import DIRECTIONS
from nvsim.mapping.criteria import OPEN, can_stand, floor_below
from nvsim.mapping.search.graph_builder import SAME, level_distance
from nvsim.mapping.search.survey import Survey

_CROWDED = 0.5  # share of the merge radius within which no second viewpoint is placed, even behind an obstacle
_LINKS = 6  # maximum viewpoints that a new start is joined to


class BreadthFirstSearch:
    """Searches viewpoints and edges from starts.

    draft      the graph found so far
    expanded   ids of the viewpoints whose eight directions were decided
    limited    whether the search stopped at the maximum number of viewpoints
    refusals   the `floor_below` of starts without room for a viewpoint
    """

    def __init__(self, survey: Survey) -> None:
        self._survey, self._lattice, self._walk, self._config = survey, survey.lattice, survey.walk, survey.config
        self._queue: deque[str] = deque()
        self._refused: set[str] = set()
        self.draft = survey.draft
        self.expanded: set[str] = set()
        self.limited = False
        self.refusals: list[tuple[float, float]] = []

    @property
    def waiting(self) -> int:
        return len(self._queue)

    def start(self, position: NDArray[np.floating]) -> bool:
        """Add a viewpoint on the trajectory at `position` (3,), meters, and join it to those around it. Returns False
        if there is no room, if a viewpoint is there already, or if the graph is full."""
        viewpoint = self._survey.viewpoint(position, "start")
        id = viewpoint.id  # near a stair, its storey may differ from that of `position`
        if id in self.draft.viewpoints or id in self._refused or self._is_full():
            return False
        self._lattice.begin(id, viewpoint.position[:2])
        around = self._survey.around(viewpoint)
        if self._config.standing and not can_stand(around, self._config):
            self._refused.add(id)
            self.refusals.append(floor_below(around, self._config))
            return False
        # Decide the corridors to viewpoints around before the steps, so that the steps find them joined.
        self._look_around(viewpoint)
        links = 0
        for other in self.draft.viewpoints_near(position, self._config.tau_dist):
            if links < _LINKS and other.id != id and self._join(viewpoint, other) == OPEN:
                links += 1
        self._step_out(viewpoint)
        return True

    def run(self, progress: Callable[[], None]) -> None:
        """Expand viewpoints until none is waiting."""
        while self._queue:
            viewpoint = self.draft.viewpoints.get(self._queue.popleft())
            if viewpoint is not None and self._arrive(viewpoint):
                self._step_out(viewpoint)
            progress()

    def _arrive(self, viewpoint: Viewpoint) -> bool:
        """Measure around a viewpoint that steps led to. Its floor and the corridors back must be free as well."""
        around = self._look_around(viewpoint)
        stands = self._config.rule == "mean" or not self._config.standing or can_stand(around, self._config)
        for id in self.draft.joined(viewpoint.id):
            other = self.draft.viewpoints[id]
            back = OPEN if not self._config.both_ways else self._survey.decide_corridor(viewpoint, other)
            if not stands or back != OPEN:
                self.draft.remove_edge(viewpoint.id, id)
                self._survey.record_omitted_edge(self.draft.viewpoints[id], viewpoint, "return")
        if self.draft.joined(viewpoint.id):
            return True
        self.draft.remove(viewpoint.id)
        self._refused.add(viewpoint.id)
        return False

    def _look_around(self, viewpoint: Viewpoint) -> list[Evidence]:
        around = self._survey.around(viewpoint)
        self._survey.add_viewpoint(viewpoint, around)
        self.expanded.add(viewpoint.id)
        return around

    def _step_out(self, viewpoint: Viewpoint) -> None:
        for k in range(DIRECTIONS):
            evidence = self.draft.evidence[viewpoint.id][k]
            if evidence.decision == OPEN:
                self.draft.store_evidence(replace(evidence, decision=self._step(viewpoint, evidence)))

    def _step(self, viewpoint: Viewpoint, evidence: Evidence) -> Decision:
        """Follow an open corridor to an existing or a new viewpoint, and return OPEN. If it leads nowhere, return the
        reason."""
        target = self._survey.arrival(viewpoint, evidence.target)
        if self._config.max_distance and self._walk.distance(target) > self._config.max_distance:
            return "distance"
        around = [v for v in self.draft.viewpoints_near(target, self._config.merge_radius) if v.id != viewpoint.id]
        if around and not self._config.checked_merges:
            self.draft.join(viewpoint.id, around[0].id, "step" if level_distance(around[0], target) < SAME else "merge")
            return OPEN
        if around and level_distance(around[0], target) < SAME:
            return self._join(viewpoint, around[0])
        if any(self._join(viewpoint, other) == OPEN for other in around):
            return OPEN
        if around and level_distance(around[0], target) < _CROWDED * self._config.merge_radius:
            return "merge"
        id = self.draft.id_at(target)
        if id in self._refused:
            return "return"
        if self._is_full():
            return "limit"
        self.draft.set_viewpoint(self._survey.viewpoint(target, "step"))
        self.draft.join(viewpoint.id, id, "step")
        self._lattice.record_step(id, viewpoint.id, evidence.direction)
        self._queue.append(id)
        return OPEN

    def _join(self, viewpoint: Viewpoint, other: Viewpoint) -> Decision:
        """Add the edge to an existing viewpoint if its corridor is free, and the corridor back if the other viewpoint
        was expanded. Otherwise return the reason."""
        if self.draft.are_joined(viewpoint.id, other.id):
            return OPEN
        decision = self._survey.decide_corridor(viewpoint, other)
        if decision != OPEN:
            return decision
        if (
            self._config.both_ways
            and other.id in self.expanded
            and self._survey.decide_corridor(other, viewpoint) != OPEN
        ):
            self._survey.record_omitted_edge(viewpoint, other, "return")
            return "return"
        step = self.draft.step_towards(viewpoint, other) is not None
        self.draft.join(viewpoint.id, other.id, "step" if step else "merge")
        return OPEN

    def _is_full(self) -> bool:
        self.limited = self.limited or len(self.draft.viewpoints) >= self._config.max_viewpoints
        return self.limited
