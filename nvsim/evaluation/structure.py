"""Metrics of a graph's structure that need a map: near viewpoints that are far apart in the graph, and detours.

For comparison, the metrics of the Matterport3D graphs, on which agents are trained, are included.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.paths import PathGraph
from nvsim.graph.structure import evenly_spaced_rows
from nvsim.graph.types import NavGraph
from nvsim.occupancy.grid_ways import Geodesics
from nvsim.occupancy.paths import points_are_free, segments_are_free, standing_room
from nvsim.occupancy.storeys import Stair, StoreyMap, StoreyMaps
from nvsim.occupancy.types import OccupancyMap

SOURCE = "the 90 scans of Matterport3DSimulator (commit 589d091)"
MATTERPORT: Mapping[str, float] = MappingProxyType(
    {
        "nodes": 10567,
        "edges": 21468,
        "mean_degree": 4.06,
        "degree_p5": 2.0,
        "degree_p95": 8.0,
        "edge_length": 2.269,
        "edge_length_p5": 0.838,
        "edge_length_p95": 4.305,
        "edge_length_max": 16.798,
        "nearest": 1.315,
        "nearest_mean": 1.377,
        "clustering": 0.433,
        "tied": 0.12595,
        "tied_episodes": 0.04982,
        "near_pairs_1.5": 5589,
        "near_far_1.5": 0.00143,
        "near_pairs_2.5": 14859,
        "near_far_2.5": 0.00922,
    }
)
"""Measured by `nvsim.graph.structure.structure` on every `connectivity/*_connectivity.json` of the source, pooled.
There is no map of these buildings, so near pairs are those that the files mark as `visible`."""
Float64 = NDArray[np.float64]
NEAR = (1.5, 2.5)
"""Meters between viewpoints that count as near."""
FAR = 3.0
"""Meters along the graph beyond which near viewpoints count as far apart (R2R's success distance)."""
LEVEL = 0.5
"""Largest height difference in meters between the floors of two viewpoints on one floor."""
_AT_ONCE = 256  # viewpoints whose paths to all others are in memory at once
_WORK = 4_000_000  # cells that the map paths from all viewpoints may visit
_SOURCES = (8, 50)  # viewpoints from which map paths are measured: fewest, most


@dataclass(frozen=True, eq=False)
class MapPaths:
    """Paths between places (N, 2), meters, whose floors are at heights (N,), world z.

    storeys   (N,) the map that each place is on
    """

    maps: StoreyMaps
    places: Float64
    storeys: NDArray[np.int64]
    _rooms: list[NDArray[np.bool_]]
    _geodesics: list[Geodesics]

    @classmethod
    def of(cls, occupancy: OccupancyMap | StoreyMaps, places: Float64, floors: Float64, radius: float) -> MapPaths:
        """Prepares paths between `places` (N, 2) with floors at heights `floors` (N,), for a robot of `radius`, all in
        meters."""
        one = isinstance(occupancy, OccupancyMap)
        maps = StoreyMaps((StoreyMap(0.0, occupancy),)) if isinstance(occupancy, OccupancyMap) else occupancy
        storeys = np.zeros(len(places), np.int64) if one else maps.nearest(floors)
        rooms = [standing_room(s.occupancy, radius) for s in maps.storeys]
        return cls(
            maps, places, storeys, rooms, [Geodesics(r, s.occupancy) for r, s in zip(rooms, maps.storeys, strict=True)]
        )

    @property
    def cells(self) -> int:
        """Number of traversable cells."""
        return sum(len(g) for g in self._geodesics)

    def can_stand(self) -> NDArray[np.bool_]:
        """(N,) bool, whether the robot can stand at each place."""
        found = np.zeros(len(self.places), bool)
        for k, storey in enumerate(self.maps.storeys):
            here = self.storeys == k
            found[here] = points_are_free(self._rooms[k], storey.occupancy, self.places[here])
        return found

    def straight(self, pairs: NDArray[np.int64]) -> NDArray[np.bool_]:
        """(P,) bool, whether the straight line between the places of each pair (P, 2) is free, on one storey."""
        a, b = pairs.T
        found = np.zeros(len(pairs), bool)
        for k, storey in enumerate(self.maps.storeys):
            here = (self.storeys[a] == k) & (self.storeys[b] == k)
            begin, end = self.places[a[here]], self.places[b[here]]
            found[here] = segments_are_free(self._rooms[k], storey.occupancy, begin, end)
        return found

    def lengths(self, sources: NDArray[np.int64], ends: NDArray[np.int64]) -> Float64:
        """(S, E) meters of the shortest paths from the places `sources` (S,) to `ends` (E,), infinite if there is none.
        Paths are on one storey or use stairs through their centers."""
        found = np.array([self._meters_from_place(self.places[s], int(self.storeys[s]), ends) for s in sources])
        found = found.reshape(len(sources), len(ends))
        if not self.maps.stairs:
            return found
        stairs, between = self.maps.stairs, self._between_stairs()
        to_ends, to_sources = (
            np.array([self._meters_to_stair(stair, rows) for stair in stairs]) for rows in (ends, sources)
        )
        over = (to_sources.T[:, :, None] + between).min(axis=1)  # from each source to each stair
        return np.asarray(np.minimum(found, (over[:, :, None] + to_ends[None]).min(axis=1)))

    def _meters_from_place(self, place: Float64, storey: int, ends: NDArray[np.int64]) -> Float64:
        """(E,) meters from a place (2,) of a storey to those of `ends` on the same storey, infinite to the others."""
        found = np.full(len(ends), np.inf)
        here = self.storeys[ends] == storey
        meters = self._geodesics[storey].lengths(place, self.places[ends[here]])
        found[here] = np.where(np.isnan(meters), np.inf, meters)
        return found

    def _meters_to_stair(self, stair: Stair, rows: NDArray[np.int64]) -> Float64:
        """(R,) meters from the center of a stair to places on the storeys that it connects."""
        middle = np.mean(stair.outline, axis=0)
        sides = [self._meters_from_place(middle, k, rows) for k in (stair.lower, stair.upper)]
        return np.minimum(*sides) + self._extra_stair_length(stair) / 2

    def _extra_stair_length(self, stair: Stair) -> float:
        """Meters by which a stair is longer than its horizontal projection."""
        corners = np.array(stair.outline)
        run = float(np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1).max())
        rise = self.maps.storeys[stair.upper].floor - self.maps.storeys[stair.lower].floor
        return float(np.hypot(run, rise) - run)

    def _between_stairs(self) -> Float64:
        """(T, T) meters of the shortest paths between the centers of stairs, including paths over other stairs."""
        stairs = self.maps.stairs
        middles = [np.mean(s.outline, axis=0) for s in stairs]
        apart = np.where(np.eye(len(stairs), dtype=bool), 0.0, np.inf)
        for i, one in enumerate(stairs):
            for j, other in enumerate(stairs[:i]):
                for k in {one.lower, one.upper} & {other.lower, other.upper}:
                    meters = self._geodesics[k].lengths(middles[i], middles[j][None])[0]
                    if np.isfinite(meters):
                        climbs = (self._extra_stair_length(one) + self._extra_stair_length(other)) / 2
                        apart[i, j] = apart[j, i] = min(apart[i, j], meters + climbs)
        for via in range(len(stairs)):
            apart = np.minimum(apart, apart[:, via, None] + apart[via])
        return apart


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
    These paths are up to 2.8 % too long (`nvsim.occupancy.grid_ways.ERROR`), so a detour is too small by up to as much.
    A metric without any pairs is 0.
    """
    ways = PathGraph.of(graph)
    over = MapPaths.of(occupancy, ways.places[:, :2], ways.floor, robot_radius)
    return {**_detours_of_near_pairs(ways, over), **_detours(ways, over)}


def _detours_of_near_pairs(ways: PathGraph, over: MapPaths) -> dict[str, float | int]:
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


def _pairs(ways: PathGraph, reach: float) -> NDArray[np.int64]:
    """(P, 2) rows of viewpoint pairs on one floor that are within reach."""
    from scipy.spatial import cKDTree

    if len(ways.ids) < 2:
        return np.zeros((0, 2), np.int64)
    pairs = cKDTree(ways.places).query_pairs(reach, output_type="ndarray").astype(np.int64)
    return pairs[np.abs(ways.floor[pairs[:, 0]] - ways.floor[pairs[:, 1]]) <= LEVEL]


def _detours(ways: PathGraph, map_paths: MapPaths) -> dict[str, float | int]:
    rows = np.flatnonzero(map_paths.can_stand())
    fewest, most = _SOURCES
    sources = rows[evenly_spaced_rows(len(rows), int(np.clip(_WORK // max(map_paths.cells, 1), fewest, most)))]
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
