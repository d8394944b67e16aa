"""Compare a navigation graph with the maps of several storeys.

A viewpoint is tested on the map of the storey whose floor is nearest to its own. Unless it is on a stair, the heights
of both floors may differ by at most half a meter. An edge within a storey is tested on that map.

An edge between two storeys uses a stair. It is cut at the point where its floor, interpolated linearly between its
ends, is halfway between the storeys. Each part is tested on the map of its storey. The cut must be on a stair that
connects the storeys and whose treads are free in both maps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import NavGraph
from nvsim.mapping.corridor import SupportAt
from nvsim.occupancy.paths import points_are_free, reachable, segments_are_free, standing_room, visible
from nvsim.occupancy.storeys import StoreyMaps

NEAR = 0.5  # meters by which the floor of a viewpoint may differ from that of its storey


def judge_storeys(
    graph: NavGraph, maps: StoreyMaps, radius: float = 0.0
) -> tuple[dict[str, bool], dict[tuple[str, str], bool]]:
    """For each included viewpoint and each edge between them, whether a disc of `radius` meters touches only free cells
    of its storeys. Unknown cells are not free."""
    ids = [id for id, v in graph.viewpoints.items() if v.included]
    places, floors = places_of(graph, ids)
    storeys = maps.nearest(floors)
    rooms = [standing_room(s.occupancy, radius) for s in maps.storeys]
    stands = _at_its_floor(maps, places, floors, storeys)
    for k, storey in enumerate(maps.storeys):
        here = storeys == k
        stands[here] &= points_are_free(rooms[k], storey.occupancy, places[here])
    row = {id: i for i, id in enumerate(ids)}
    keys = [key for key in graph.edges if key[0] in row and key[1] in row]
    ends = np.array([(row[a], row[b]) for a, b in keys], np.int64).reshape(-1, 2)
    cuts, runs = _cuts(maps, places, floors, storeys, ends)
    for side in (0, 1):
        for k, storey in enumerate(maps.storeys):
            here = storeys[ends[:, side]] == k
            begin = places[ends[here, side]]
            runs[here] &= segments_are_free(rooms[k], storey.occupancy, begin, cuts[here, side])
    return dict(zip(ids, stands.tolist(), strict=True)), dict(zip(keys, runs.tolist(), strict=True))


def covered_areas(
    graph: NavGraph,
    maps: StoreyMaps,
    ids: list[str],
    trajectory: NDArray[np.floating],
    reach: float,
    seen: SupportAt | None = None,
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Two pairs of areas in square meters, summed over all storeys.

    The first pair is the covered area and the area reachable from the `trajectory` (N, 3) in meters. Covered means
    within `reach` meters and in line of sight of the viewpoints `ids`. The second pair is limited to floor that is
    `seen`. Treads count on both storeys that they connect, and viewpoints on treads see both storeys."""
    places, floors = places_of(graph, ids)
    storeys, walked = maps.nearest(floors), maps.beneath(trajectory[:, 2])
    whole, shown = np.zeros(2), np.zeros(2)
    for k, storey in enumerate(maps.storeys):
        here = storeys == k
        for stair in maps.stairs:
            if k in (stair.lower, stair.upper):
                here |= stair.holds(places) & np.isin(storeys, (stair.lower, stair.upper))
        area = reachable(storey.occupancy, trajectory[walked == k, :2])
        covered = visible(storey.occupancy, places[here], reach) & area
        cell = storey.occupancy.resolution**2
        whole += [cell * float(covered.sum()), cell * float(area.sum())]
        if seen is not None:
            centres = storey.occupancy.centres()
            heights = np.full((*centres.shape[:2], 1), storey.floor)
            known = area & np.asarray(seen(np.concatenate([centres, heights], axis=-1)), bool)
            shown += [cell * float((covered & known).sum()), cell * float(known.sum())]
    return (float(whole[0]), float(whole[1])), (float(shown[0]), float(shown[1]))


def climbing(graph: NavGraph, maps: StoreyMaps, keys: list[tuple[str, str]]) -> list[tuple[str, str]]:
    """The edges that lead from one storey to another."""
    sides = [maps.nearest(places_of(graph, [key[side] for key in keys])[1]) for side in (0, 1)]
    return [key for key, a, b in zip(keys, *sides, strict=True) if a != b]


def places_of(graph: NavGraph, ids: list[str]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(N, 2) world x, y of viewpoints and (N,) the height of the floor below them, meters."""
    chosen = [graph.viewpoints[id] for id in ids]
    places = np.array([v.position for v in chosen], np.float64).reshape(-1, 3)
    return places[:, :2], places[:, 2] - np.array([v.height for v in chosen], np.float64)


def _at_its_floor(
    maps: StoreyMaps, places: NDArray[np.float64], floors: NDArray[np.float64], storeys: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """(N,) bool, whether the floor of each place is that of its storey, or is on a stair of that storey."""
    levels = np.array([s.floor for s in maps.storeys])
    fits = np.abs(floors - levels[storeys]) <= NEAR
    for stair in maps.stairs:
        between = (floors > levels[stair.lower] - NEAR) & (floors < levels[stair.upper] + NEAR)
        fits |= between & stair.holds(places) & np.isin(storeys, (stair.lower, stair.upper))
    return np.asarray(fits)


def _cuts(
    maps: StoreyMaps,
    places: NDArray[np.float64],
    floors: NDArray[np.float64],
    storeys: NDArray[np.int64],
    ends: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """(E, 2, 2) for each end of the edges between the places `ends` (E, 2), the point up to which its storey's map is
    used. (E,) bool, whether the edge is possible: it is within a storey or on a stair."""
    levels = np.array([s.floor for s in maps.storeys])
    a, b = ends.T
    half = (levels[storeys[a]] + levels[storeys[b]]) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.clip((half - floors[a]) / (floors[b] - floors[a]), 0, 1)
    climbs = storeys[a] != storeys[b]
    share = np.where(climbs, share, 1.0)[:, None]
    cut = places[a] + share * (places[b] - places[a])
    runs = ~climbs
    for stair in maps.stairs:
        low, high = np.minimum(storeys[a], storeys[b]), np.maximum(storeys[a], storeys[b])
        runs |= (low == stair.lower) & (high == stair.upper) & stair.holds(cut)
    second = np.where(climbs[:, None], cut, places[a])
    return np.stack([cut, second], axis=1), runs
