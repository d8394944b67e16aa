"""Corridors decided and their evidence kept with the graph that grows: what the search and the settling both ask."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Decision, Evidence, Viewpoint, ViewpointOrigin
from nvsim.mapping.climbing import CLIMB
from nvsim.mapping.config import WIDEST, MappingConfig
from nvsim.mapping.corridor import HeightAt
from nvsim.mapping.criteria import OPEN, decide
from nvsim.mapping.graph_builder import SAME, GraphBuilder, apart
from nvsim.mapping.lattice import Lattice
from nvsim.mapping.measuring import Measurements
from nvsim.mapping.walk import Walk


class Survey:
    """The graph so far, what is measured for it, and the trajectory that it lies around."""

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
        """A viewpoint whose camera is at a place (3,); the graph does not hold it yet."""
        x, y, z = (float(value) for value in self._over_floor(place))
        floor = float(self._floor_at(np.array([x, y, z])))
        return Viewpoint(self.draft.id_at(np.array([x, y, z])), (x, y, z), z - floor, -1, True, origin)

    def arrival(self, viewpoint: Viewpoint, target: tuple[float, float]) -> NDArray[np.float64]:
        """(3,) the camera over `target` (x, y), where a step from a viewpoint leads: at the height of the camera of the
        trajectory that is nearest to where it arrives."""
        place = np.array(self._measurements.arrival(viewpoint, target))
        place[2] = self.walk.height(place)
        return self._over_floor(place)

    def is_level(self, place: NDArray[np.floating]) -> bool:
        """Whether a camera at a place (3,) is as high above the floor as cameras were carried, and not on the height of
        a storey over or beneath a stair, where the trajectory alone leads."""
        return bool(abs(self._over_floor(place)[2] - place[2]) <= CLIMB)

    def _over_floor(self, place: NDArray[np.floating]) -> NDArray[np.float64]:
        """A place (3,), where storeys lie over one another as high above its floor as cameras were carried: beside a
        camera on a stair the floor may be that of a higher step or of a storey."""
        x, y, z = (float(value) for value in place)
        if self._carried is None:
            return np.array([x, y, z])
        floor = float(self._floor_at(place))
        right = abs(z - floor - self._carried) <= CLIMB
        return np.array([x, y, z if right else floor + self._carried])

    def around(self, viewpoint: Viewpoint) -> list[Evidence]:
        """The evidence of the eight directions, undecided."""
        # That far the viewpoints are that steps may merge with.
        reach = self.config.tau_dist + self.config.merge_radius
        return self._measurements.around(viewpoint, self.draft.near(np.array(viewpoint.position), reach))

    def take(self, viewpoint: Viewpoint, around: Iterable[Evidence]) -> None:
        """Puts a viewpoint into the graph with the decisions about its eight directions."""
        around = list(around)
        self.draft.put(replace(viewpoint, submap=around[0].submap))
        for evidence in around:
            self.keep(replace(evidence, decision=decide(evidence, self.config)))

    def way(self, viewpoint: Viewpoint, other: Viewpoint, also: Iterable[Viewpoint] = ()) -> Decision:
        """The decision about the corridor from one viewpoint to another; its evidence is kept. `also` as
        `Measurements.between` takes it."""
        step = self.draft.step_towards(viewpoint, other)
        if step is not None:
            return decide(step, self.config)
        found = self._measurements.between(viewpoint, other, also)
        decision = decide(found, self.config)
        direction = self.draft.number_towards(viewpoint.id, other.id)
        self.keep(replace(found, direction=direction, decision=decision))
        return decision

    def known(self, viewpoint: Viewpoint, other: Viewpoint, spare: float = 0.0) -> Decision:
        """What the evidence that is kept decides about the corridor to another viewpoint, `spare` metres wider at
        either side as far as was measured; "" where there is no evidence."""
        config = self.config
        if spare:
            config = replace(config, margin=min(config.margin + spare, WIDEST / 2 - config.robot_radius))
        return next((decide(evidence, config) for evidence in self._towards(viewpoint, other)), "")

    def left_out(self, viewpoint: Viewpoint, other: Viewpoint) -> Decision:
        """What the search or the settling said of the corridor to another viewpoint; "" where there is no evidence."""
        return next((evidence.decision for evidence in self._towards(viewpoint, other)), "")

    def knows_floor(self, a: Viewpoint, b: Viewpoint) -> bool:
        """Whether enough floor is known along the corridor from one place to another, which needs no rendering."""
        return self._measurements.knows_floor(a, b)

    def leave_out(self, viewpoint: Viewpoint, other: Viewpoint, why: Decision) -> None:
        """Says in the open evidence from one viewpoint to another why there is no edge."""
        for evidence in self._towards(viewpoint, other):
            if evidence.decision == OPEN:
                self.keep(replace(evidence, decision=why))

    def _towards(self, viewpoint: Viewpoint, other: Viewpoint) -> Iterator[Evidence]:
        """What is kept of the corridors from one viewpoint to the place of another."""
        for evidence in list(self.draft.evidence[viewpoint.id].values()):
            if evidence.joins == other.id or apart(other, evidence.target) < SAME:
                yield evidence

    def keep(self, evidence: Evidence) -> None:
        """Evidence in place of what was known of the same direction."""
        self.draft.keep(evidence)
