"""Metrics of a graph's structure that need a map: near viewpoints that are far apart in the graph, and detours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.map_paths import MapPaths
from nvsim.graph.structure import spread_rows
from nvsim.graph.types import NavGraph
from nvsim.graph.ways import Ways
from nvsim.occupancy.storeys import StoreyMaps
from nvsim.occupancy.types import OccupancyMap

NEAR = (1.5, 2.5)
"""Meters between viewpoints that count as near."""
FAR = 3.0
"""Meters along the graph beyond which near viewpoints count as far apart (R2R's success distance)."""
LEVEL = 0.5
"""Largest height difference in meters between the floors of two viewpoints on one floor."""
_AT_ONCE = 256  # viewpoints whose paths to all others are in memory at once
_WORK = 4_000_000  # cells that the map paths from all viewpoints may visit
_SOURCES = (8, 50)  # viewpoints from which map paths are measured: fewest, most


def map_structure(
    graph: NavGraph, occupancy: OccupancyMap | StoreyMaps, robot_radius: float = 0.25
) -> dict[str, float | int]:
    """Metrics of `graph` on a map in its frame, or on the maps of storeys, for a robot of `robot_radius` meters.

    near_pairs_1.5, near_pairs_2.5   pairs of included viewpoints on one floor that are nearer than so many meters and
                                     have a free straight line between them
    near_far_1.5, near_far_2.5       share of these pairs that is over FAR meters apart along the graph, or not
                                     connected
    detour, detour_p95      path along the graph / shortest path on the map, median and 95th percentile, of the pairs
                            that both connect
    unreachable             share of the pairs connected on the map that the graph does not connect
    detour_pairs            number of pairs connected on the map

    Map paths lead from 8 to 50 viewpoints where the robot can stand to all others. The selection is deterministic.
    These paths are up to 2.8 % too long (`nvsim.occupancy.geodesic.ERROR`), so a detour is too small by up to as much.
    A metric without any pairs is 0.
    """
    ways = Ways.of(graph)
    over = MapPaths.of(occupancy, ways.places[:, :2], ways.floor, robot_radius)
    return {**_near(ways, over), **_detours(ways, over)}


def _near(ways: Ways, over: MapPaths) -> dict[str, float | int]:
    pairs = _pairs(ways, max(NEAR))
    pairs = pairs[over.straight(pairs)]
    apart = np.linalg.norm(ways.places[pairs[:, 0]] - ways.places[pairs[:, 1]], axis=1)
    far = np.ones(len(pairs), bool)
    firsts = np.unique(pairs[:, 0])
    for some in np.array_split(firsts, max(1, -(-len(firsts) // _AT_ONCE))):
        mine = np.isin(pairs[:, 0], some)
        along = ways.lengths(some, FAR)
        far[mine] = ~(along[np.searchsorted(some, pairs[mine, 0]), pairs[mine, 1]] <= FAR)
    figures: dict[str, float | int] = {}
    for limit in NEAR:
        chosen = apart < limit
        figures[f"near_pairs_{limit}"] = int(chosen.sum())
        figures[f"near_far_{limit}"] = round(float(far[chosen].mean()), 5) if chosen.any() else 0.0
    return figures


def _pairs(ways: Ways, reach: float) -> NDArray[np.int64]:
    """(P, 2) rows of viewpoint pairs on one floor that are within reach."""
    from scipy.spatial import cKDTree

    if len(ways.ids) < 2:
        return np.zeros((0, 2), np.int64)
    pairs = cKDTree(ways.places).query_pairs(reach, output_type="ndarray").astype(np.int64)
    return pairs[np.abs(ways.floor[pairs[:, 0]] - ways.floor[pairs[:, 1]]) <= LEVEL]


def _detours(ways: Ways, map_paths: MapPaths) -> dict[str, float | int]:
    rows = np.flatnonzero(map_paths.stand())
    fewest, most = _SOURCES
    sources = rows[spread_rows(len(rows), int(np.clip(_WORK // max(map_paths.cells, 1), fewest, most)))]
    along = ways.lengths(sources)[:, rows] if len(sources) else np.zeros((0, 0))
    over = map_paths.lengths(sources, rows) if len(sources) else np.zeros((0, 0))
    pairs = np.isfinite(over) & (over > 0)
    both = pairs & np.isfinite(along)
    ratios = along[both] / over[both]
    return {
        "detour": round(float(np.median(ratios)), 4) if len(ratios) else 0.0,
        "detour_p95": round(float(np.percentile(ratios, 95)), 4) if len(ratios) else 0.0,
        "unreachable": round(1 - float(both.sum()) / float(pairs.sum()), 5) if pairs.any() else 0.0,
        "detour_pairs": int(pairs.sum()),
    }
