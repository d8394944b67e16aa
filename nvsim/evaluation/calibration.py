"""Measure the effect of each map builder threshold from the stored evidence alone, without rendering."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.evaluation.calibrated import Calibration, Judge
from nvsim.evaluation.interval import wilson
from nvsim.graph.types import Evidence, NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.criteria import CRITERIA, Criterion
from nvsim.mapping.evidence.evidence_stack import EvidenceStack
from nvsim.mapping.evidence.rethreshold import Rethresholder
from nvsim.mapping.search.graph_builder import SAME
from nvsim.occupancy.paths import reachable, segments_are_free, standing_room, visible
from nvsim.occupancy.types import FREE, OccupancyMap

_OPEN = 0  # the code of an open corridor
_STEPS = 101  # values of a sweep, from 0 to 1
_REACH = 2.5  # meters that a viewpoint covers, as in evaluate_graph


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
        ways = _corridor_numbers(at, _end_rows(evidence, xy), len(row))
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


def _end_rows(evidence: list[Evidence], xy: NDArray[np.float64]) -> NDArray[np.int64]:
    """(E,) the row of the viewpoint at the end of each corridor, -1 if there is none."""
    from scipy.spatial import cKDTree

    lead = np.full(len(evidence), -1, np.int64)
    if evidence:
        far, near = cKDTree(xy).query(np.array([e.target for e in evidence], np.float64))
        lead[far < SAME] = near[far < SAME]
    return lead


def _corridor_numbers(at: NDArray[np.int64], lead: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """(E,) one number for all corridors between the same two viewpoints. A corridor without a viewpoint at its end has
    its own number."""
    between = np.minimum(at, lead) * count + np.maximum(at, lead)
    return np.where(lead >= 0, between, -1 - np.arange(len(at)))


def calibrate(
    graph: NavGraph,
    occupancy: OccupancyMap,
    positions: NDArray[np.floating],
    config: MappingConfig,
    want: float = 0.99,
    robot_radius: float = 0.25,
) -> Calibration:
    """Sweeps every threshold that `config` uses. `positions` (N, 3) of the cameras in meters, and the occupancy map,
    are in the graph's frame.

    The suggestion is the loosest threshold whose validity has a 95 % interval (Wilson) with a lower end of at least
    `want`. Raises InputError if `want` is not between 0 and 1, or if the graph has no evidence.
    """
    if not 0 < want < 1:
        raise InputError(f"--want is {want:g}; give a share between 0 and 1, such as 0.99.")
    if not graph.evidence:
        raise InputError("The graph has no evidence for new decisions; build it with `nvsim map --project`.")
    measure = _ThresholdScorer(graph, occupancy, positions, robot_radius)
    asked = [c for c in CRITERIA if c.is_used(config)]
    sweeps = {}
    for criterion in asked:
        values = np.unique(np.round([*np.linspace(0, 1, _STEPS), criterion.limit(config)], 6)).tolist()
        sweeps[criterion.field] = [
            {"threshold": value, **measure(replace(config, **{criterion.field: value}))} for value in values
        ]
    now = measure(config)
    suggested = [_suggestion(c, sweeps[c.field], now, config, want, judge) for c in asked for judge in get_args(Judge)]
    return Calibration(want, now, sweeps, suggested)


def _suggestion(
    criterion: Criterion,
    rows: list[dict[str, Any]],
    now: dict[str, Any],
    config: MappingConfig,
    want: float,
    judge: Judge,
) -> dict[str, Any]:
    suffix = "" if judge == "point" else "_robot"
    found: dict[str, Any] = {"criterion": criterion.field, "judge": judge, "now": criterion.limit(config)}
    good = [row for row in rows if row["low" + suffix] >= want]
    if not good:
        best = max(rows, key=lambda row: float(row["low" + suffix]))
        return {**found, "threshold": None, "best_low": best["low" + suffix], "best_threshold": best["threshold"]}
    row = good[-1] if criterion.below else good[0]
    named = {name: row[name + suffix] for name in ("validity", "low", "high", "recall")}
    change = {f"{name}_change": round(row[name] - now[name], 5) for name in ("edges", "viewpoints", "coverage")}
    return {**found, "threshold": row["threshold"], **named, "share": row["share"], **change, "beyond": row["beyond"]}


class _ThresholdScorer:
    """Computes the metrics of one set of thresholds."""

    def __init__(
        self, graph: NavGraph, occupancy: OccupancyMap, positions: NDArray[np.floating], robot_radius: float
    ) -> None:
        self._corridors = Corridors(graph, occupancy, robot_radius)
        self._again = Rethresholder(graph, positions)
        self._area = reachable(occupancy, positions[:, :2])
        row = {id: i for i, id in enumerate(graph.viewpoints)}
        self._included = np.array([v.included for v in graph.viewpoints.values()], bool)
        self._edges = {(min(row[a], row[b]), max(row[a], row[b])) for a, b in graph.edges}
        xy = np.array([v.position[:2] for v in graph.viewpoints.values()], np.float64).reshape(-1, 2)
        stands = occupancy.states_at(xy) == FREE
        self._covers = [
            np.flatnonzero(visible(occupancy, place, _REACH) & self._area) if good else np.zeros(0, np.int64)
            for place, good in zip(xy, stands.tolist(), strict=True)
        ]
        self._known: dict[bytes, float] = {}

    def __call__(self, config: MappingConfig) -> dict[str, Any]:
        accepted = self._corridors.accepted(config)
        count = int(accepted.sum())
        figures: dict[str, Any] = {
            "corridors": len(accepted),
            "accepted": count,
            "share": _share(count, len(accepted)),
        }
        for suffix, free in (("", self._corridors.free), ("_robot", self._corridors.free_robot)):
            valid = int((accepted & free).sum())
            low, high = wilson(valid, count)
            figures["valid" + suffix] = valid
            figures["validity" + suffix] = _share(valid, count)
            figures["low" + suffix], figures["high" + suffix] = round(low, 5), round(high, 5)
            figures["recall" + suffix] = _share(valid, int(free.sum()))
        again = self._again.decide(config)
        edges = self._edges - set(map(tuple, again.lost_edges.tolist())) | set(map(tuple, again.new_edges.tolist()))
        walked = [edge for edge in edges if self._included[list(edge)].all()]
        joined = np.zeros(len(self._included), bool)
        joined[np.array(walked, np.int64).ravel()] = True
        figures |= {"viewpoints": int(joined.sum()), "edges": len(walked), "coverage": self._coverage(joined)}
        return {**figures, "beyond": again.new_steps}

    def _coverage(self, viewpoints: NDArray[np.bool_]) -> float:
        """Share of the free area reachable from the trajectory. Cached, as many thresholds keep the same viewpoints."""
        key = viewpoints.tobytes()
        if key not in self._known:
            seen = np.zeros(self._area.size, bool)
            for i in np.flatnonzero(viewpoints):
                seen[self._covers[i]] = True
            self._known[key] = _share(int(seen.sum()), int(self._area.sum()))
        return self._known[key]


def _share(part: int, whole: int) -> float:
    return round(part / whole, 5) if whole else 0.0
