"""Decide corridors and store their evidence in the growing graph, for the search and for settling."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Evidence, Viewpoint, ViewpointOrigin
from nvsim.mapping.config import WIDEST, MappingConfig
from nvsim.mapping.corridor import HeightAt, Lattice
from nvsim.mapping.criteria import OPEN, decide
from nvsim.mapping.evidence.measuring import Measurements
from nvsim.mapping.evidence.traversed_floor import CLIMB
from nvsim.mapping.search.graph_builder import SAME, GraphBuilder, level_distance
from nvsim.mapping.search.trajectory import Walk


class Survey:
    """The growing graph, its measurements, and the trajectory around which it is built."""

    def __init__(
        self,
        draft: GraphBuilder,
        lattice: Lattice,
        measurements: Measurements,
        walk: Walk,
        floor_at: HeightAt,
        config: MappingConfig,
    ) -> None:
        self.draft, self.lattice, self.walk, self.config = draft, lattice, walk, config
        self._measurements, self._floor_at = measurements, floor_at
        over = walk.places[:, 2] - np.asarray(floor_at(walk.places), np.float64)
        self._carried = float(np.median(over)) if walk.is_stacked else None

    def viewpoint(self, place: NDArray[np.floating], origin: ViewpointOrigin) -> Viewpoint:
        """Return a viewpoint with its camera at `place` (3,), meters, world. It is not in the graph yet."""
        x, y, z = (float(value) for value in self._over_floor(place))
        floor = float(self._floor_at(np.array([x, y, z])))
        return Viewpoint(self.draft.id_at(np.array([x, y, z])), (x, y, z), z - floor, -1, True, origin)

    def arrival(self, viewpoint: Viewpoint, target: tuple[float, float]) -> NDArray[np.float64]:
        """Return (3,) the camera position in meters, world, over `target` (x, y), where a step from a viewpoint leads.
        Its height is that of the camera of the trajectory that is nearest to the end of the step."""
        place = np.array(self._measurements.arrival(viewpoint, target))
        place[2] = self.walk.height(place)
        return self._over_floor(place)

    def is_level(self, place: NDArray[np.floating]) -> bool:
        """Whether a camera at `place` (3,) is as high above the floor as cameras were carried. Near stairs it can be at
        the height of another storey, which only the trajectory leads to."""
        return bool(abs(self._over_floor(place)[2] - place[2]) <= CLIMB)

    def _over_floor(self, place: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return `place` (3,); in stacked storeys, as high above its floor as cameras were carried. Beside a camera on
        stairs, the floor may be a higher step or another storey."""
        x, y, z = (float(value) for value in place)
        if self._carried is None:
            return np.array([x, y, z])
        floor = float(self._floor_at(place))
        right = abs(z - floor - self._carried) <= CLIMB
        return np.array([x, y, z if right else floor + self._carried])

    def around(self, viewpoint: Viewpoint) -> list[Evidence]:
        """Return the evidence of the eight directions, without decisions."""
        # Steps may merge with viewpoints within this distance.
        reach = self.config.tau_dist + self.config.merge_radius
        return self._measurements.around(viewpoint, self.draft.viewpoints_near(np.array(viewpoint.position), reach))

    def add_viewpoint(self, viewpoint: Viewpoint, around: Iterable[Evidence]) -> None:
        """Add a viewpoint to the graph with the decisions about its eight directions."""
        around = list(around)
        self.draft.set_viewpoint(replace(viewpoint, submap=around[0].submap))
        for evidence in around:
            self.draft.store_evidence(replace(evidence, decision=decide(evidence, self.config)))

    def decide_corridor(self, viewpoint: Viewpoint, other: Viewpoint, also: Iterable[Viewpoint] = ()) -> Decision:
        """Return the decision about the corridor from one viewpoint to another, and store its evidence. `also` is as in
        `Measurements.corridor_evidence`."""
        step = self.draft.step_towards(viewpoint, other)
        if step is not None:
            return decide(step, self.config)
        found = self._measurements.corridor_evidence(viewpoint, other, also)
        decision = decide(found, self.config)
        direction = self.draft.number_towards(viewpoint.id, other.id)
        self.draft.store_evidence(replace(found, direction=direction, decision=decision))
        return decision

    def known(self, viewpoint: Viewpoint, other: Viewpoint, spare: float = 0.0) -> Decision:
        """Return the decision of the stored evidence about the corridor to another viewpoint, `spare` meters wider on
        either side as far as was measured. "" without evidence."""
        config = self.config
        if spare:
            config = replace(config, margin=min(config.margin + spare, WIDEST / 2 - config.robot_radius))
        return next((decide(evidence, config) for evidence in self._evidence_towards(viewpoint, other)), "")

    def decision_between(self, viewpoint: Viewpoint, other: Viewpoint) -> Decision:
        """Return the stored decision of the search or of settling about the corridor to another viewpoint. "" without
        evidence."""
        return next((evidence.decision for evidence in self._evidence_towards(viewpoint, other)), "")

    def knows_floor(self, a: Viewpoint, b: Viewpoint) -> bool:
        """Whether enough floor is known along the corridor from one viewpoint to another. This needs no rendering."""
        return self._measurements.knows_floor(a, b)

    def record_omitted_edge(self, viewpoint: Viewpoint, other: Viewpoint, why: Decision) -> None:
        """Store in the open evidence from one viewpoint to another why there is no edge."""
        for evidence in self._evidence_towards(viewpoint, other):
            if evidence.decision == OPEN:
                self.draft.store_evidence(replace(evidence, decision=why))

    def _evidence_towards(self, viewpoint: Viewpoint, other: Viewpoint) -> Iterator[Evidence]:
        """Yield the stored evidence of corridors from one viewpoint to the position of another."""
        for evidence in list(self.draft.evidence[viewpoint.id].values()):
            if evidence.joins == other.id or level_distance(other, evidence.target) < SAME:
                yield evidence
