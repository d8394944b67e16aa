"""The corridors along which a graph's evidence was measured, each tested on an occupancy map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Evidence, NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence_stack import EvidenceStack
from nvsim.mapping.graph_builder import SAME
from nvsim.occupancy.paths import segments_are_free, standing_room
from nvsim.occupancy.types import OccupancyMap

_OPEN = 0  # the code of an open corridor


class Corridors:
    """Corridors of a graph. The two directions between two viewpoints count as one corridor, as they give one edge.

    free, free_robot  (W,) bool, whether a point, and a disc of the robot's radius, touches only free cells along each
                      corridor
    """

    def __init__(self, graph: NavGraph, occupancy: OccupancyMap, robot_radius: float) -> None:
        """robot_radius: meters. Evidence that is stale, or whose viewpoint was removed, is skipped."""
        row = {id: i for i, id in enumerate(graph.viewpoints)}
        evidence = [e for e in graph.evidence.values() if e.viewpoint in row and not e.stale]
        at = np.array([row[e.viewpoint] for e in evidence], np.int64)
        xy = np.array([v.position[:2] for v in graph.viewpoints.values()], np.float64).reshape(-1, 2)
        self._stack = EvidenceStack(evidence, at, len(row))
        ways = _ways(at, _leads(evidence, xy), len(row))
        _, first, self._way = np.unique(ways, return_index=True, return_inverse=True)
        starts = xy[at[first]]
        stops = np.array([evidence[i].target for i in first], np.float64).reshape(-1, 2)
        self.free, self.free_robot = (
            segments_are_free(standing_room(occupancy, radius), occupancy, starts, stops)
            for radius in (0.0, robot_radius)
        )

    def accepted(self, config: MappingConfig) -> NDArray[np.bool_]:
        """(W,) bool, whether `config` accepts each corridor. If `config` requires both directions, all evidence along
        it must pass, otherwise any."""
        passes = self._stack.decide(config) == _OPEN
        count = np.bincount(self._way, minlength=len(self.free))
        good = np.bincount(self._way, passes, len(self.free))
        return np.asarray(good == count if config.both_ways else good > 0)


def _leads(evidence: list[Evidence], xy: NDArray[np.float64]) -> NDArray[np.int64]:
    """(E,) the row of the viewpoint at the end of each corridor, -1 if there is none."""
    from scipy.spatial import cKDTree

    lead = np.full(len(evidence), -1, np.int64)
    if evidence:
        far, near = cKDTree(xy).query(np.array([e.target for e in evidence], np.float64))
        lead[far < SAME] = near[far < SAME]
    return lead


def _ways(at: NDArray[np.int64], lead: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(E,) one number for all corridors between the same two viewpoints. A corridor without a viewpoint at its end has
    its own number."""
    between = np.minimum(at, lead) * count + np.maximum(at, lead)
    return np.where(lead >= 0, between, -1 - np.arange(len(at)))
