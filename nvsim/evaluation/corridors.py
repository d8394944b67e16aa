"""The straight ways that the evidence of a graph was measured along, each judged by an occupancy map."""

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
    """Corridors there and back are one way, as one edge would come of both: they are no two cases.

    free, free_robot  (W,) bool, whether a point, and a disc of the robot's radius, touch free cells only along each way
    """

    def __init__(self, graph: NavGraph, occupancy: OccupancyMap, robot_radius: float) -> None:
        """Evidence that is stale, or of viewpoints that are gone, is left out."""
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
        """(W,) whether `config` takes each way: where it asks for both ways, all that was measured along it must pass,
        else any of it."""
        passes = self._stack.decide(config) == _OPEN
        count = np.bincount(self._way, minlength=len(self.free))
        good = np.bincount(self._way, passes, len(self.free))
        return np.asarray(good == count if config.both_ways else good > 0)


def _leads(evidence: list[Evidence], xy: NDArray[np.float64]) -> NDArray[np.int64]:
    """(E,) the row of the viewpoint that stands where each corridor ends, -1 where none does."""
    from scipy.spatial import cKDTree

    lead = np.full(len(evidence), -1, np.int64)
    if evidence:
        far, near = cKDTree(xy).query(np.array([e.target for e in evidence], np.float64))
        lead[far < SAME] = near[far < SAME]
    return lead


def _ways(at: NDArray[np.int64], lead: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(E,) one number for all corridors between the same two viewpoints; what leads nowhere is a way of its own."""
    between = np.minimum(at, lead) * count + np.maximum(at, lead)
    return np.where(lead >= 0, between, -1 - np.arange(len(at)))
