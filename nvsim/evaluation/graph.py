"""Compare a navigation graph with the occupancy maps of one or more storeys: validity of nodes and edges, coverage.

A viewpoint is tested on the map of the storey whose floor is nearest to its own. Unless it is on a stair, the heights
of both floors may differ by at most half a meter. An edge within a storey is tested on that map.

An edge between two storeys uses a stair. It is cut at the point where its floor, interpolated linearly between its
ends, is halfway between the storeys. Each part is tested on the map of its storey. The cut must be on a stair that
connects the storeys and whose treads are free in both maps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.interval import wilson
from nvsim.evaluation.structure import map_structure
from nvsim.graph.paths import components
from nvsim.graph.structure import structure
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import SupportAt
from nvsim.occupancy.paths import points_are_free, reachable, segments_are_free, standing_room, visible
from nvsim.occupancy.storeys import StoreyMaps
from nvsim.occupancy.types import OccupancyMap

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
    cuts, runs = _map_boundary_on_edges(maps, places, floors, storeys, ends)
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
    storeys, walked = maps.nearest(floors), maps.storey_under(trajectory[:, 2])
    whole, shown = np.zeros(2), np.zeros(2)
    for k, storey in enumerate(maps.storeys):
        here = storeys == k
        for stair in maps.stairs:
            if k in (stair.lower, stair.upper):
                here |= stair.contains(places) & np.isin(storeys, (stair.lower, stair.upper))
        area = reachable(storey.occupancy, trajectory[walked == k, :2])
        covered = visible(storey.occupancy, places[here], reach) & area
        cell = storey.occupancy.resolution**2
        whole += [cell * float(covered.sum()), cell * float(area.sum())]
        if seen is not None:
            centers = storey.occupancy.centers()
            heights = np.full((*centers.shape[:2], 1), storey.floor)
            known = area & np.asarray(seen(np.concatenate([centers, heights], axis=-1)), bool)
            shown += [cell * float((covered & known).sum()), cell * float(known.sum())]
    return (float(whole[0]), float(whole[1])), (float(shown[0]), float(shown[1]))


def edges_between_storeys(graph: NavGraph, maps: StoreyMaps, keys: list[tuple[str, str]]) -> list[tuple[str, str]]:
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
        fits |= between & stair.contains(places) & np.isin(storeys, (stair.lower, stair.upper))
    return np.asarray(fits)


def _map_boundary_on_edges(
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
        runs |= (low == stair.lower) & (high == stair.upper) & stair.contains(cut)
    second = np.where(climbs[:, None], cut, places[a])
    return np.stack([cut, second], axis=1), runs


def judge(
    graph: NavGraph, occupancy: OccupancyMap | StoreyMaps, radius: float = 0.0
) -> tuple[dict[str, bool], dict[tuple[str, str], bool]]:
    """For each included viewpoint and each edge between them, whether a disc of `radius` meters there touches only free
    cells. Unknown cells are not free. With the maps of several storeys see `judge_storeys`."""
    if isinstance(occupancy, StoreyMaps):
        return judge_storeys(graph, occupancy, radius)
    room = standing_room(occupancy, radius)
    included = {id: v for id, v in graph.viewpoints.items() if v.included}
    places = _places(graph, list(included))
    nodes = dict(zip(included, points_are_free(room, occupancy, places).tolist(), strict=True))
    keys = [key for key in graph.edges if key[0] in included and key[1] in included]
    starts, ends = (_places(graph, [key[side] for key in keys]) for side in (0, 1))
    return nodes, dict(zip(keys, segments_are_free(room, occupancy, starts, ends).tolist(), strict=True))


def evaluate_graph(
    graph: NavGraph,
    occupancy: OccupancyMap | StoreyMaps,
    trajectory: NDArray[np.floating],
    robot_radius: float = 0.25,
    coverage_range: float = 2.5,
    seen: SupportAt | None = None,
    photographed: float = MappingConfig.photographed,
) -> dict[str, Any]:
    """Metrics of `graph` on `occupancy`, both in one frame. `trajectory` (N, 2) in meters determines the reachable
    area. `seen` tells whether the capture shows floor at world x, y (..., 2), such as `FloorSupport.is_supported`.
    With maps of several storeys both need heights: `trajectory` (N, 3) of the cameras, and `seen` at (..., 3).

    nodes, edges                   included viewpoints, and edges between them
    node_validity, edge_validity   share on free cells, for a point; with _robot for a disc of `robot_radius` meters.
                                   Each also has its count (valid_nodes and so on) and its 95 % interval (_low, _high)
    coverage                       share of the free area reachable from the trajectory, for a point, that is within
                                   `coverage_range` meters and in line of sight of a valid viewpoint
    coverage_seen, seen_m2         the same share of the part of that area that is `seen`, and its size; only with
                                   `seen`
    hazy_viewpoints                included viewpoints whose photographed share is below `photographed`; only if the
                                   shares were measured, like the next line
    coverage_without_hazy          coverage by the other viewpoints; with `seen` also coverage_seen_without_hazy
    reachable_m2, components, largest_component (share of the nodes), isolated

    The metrics of `nvsim.graph.structure.structure` and `nvsim.evaluation.structure.map_structure` are included. With
    several storeys, coverage is over all of them, and there are in addition:

    storeys                        their number
    stair_edges                    edges from one storey to another; stair_edge_validity and so on refer to these

    Shares are 0 to 1, and 0 if there are no cases.
    """
    nodes, edges = judge(graph, occupancy)
    nodes_robot, edges_robot = judge(graph, occupancy, robot_radius)
    valid = [id for id, good in nodes.items() if good]
    around = _coverage_shares(graph, occupancy, valid, trajectory, coverage_range, seen)
    shares = {id: share for id in nodes if (share := graph.viewpoints[id].photographed) is not None}
    if shares:
        hazy = {id for id, share in shares.items() if share < photographed}
        rest = _coverage_shares(
            graph, occupancy, [id for id in valid if id not in hazy], trajectory, coverage_range, seen
        )
        around["hazy_viewpoints"] = len(hazy)
        around |= {f"{name}_without_hazy": rest[name] for name in ("coverage", "coverage_seen") if name in rest}
    groups = components(graph)
    return {
        "nodes": len(nodes),
        "edges": len(edges),
        **_validity("node", "", nodes),
        **_validity("edge", "", edges),
        **_validity("node", "_robot", nodes_robot),
        **_validity("edge", "_robot", edges_robot),
        **around,
        "components": len(groups),
        "largest_component": _share(len(groups[0]) if groups else 0, len(nodes)),
        "isolated": sum(len(g) == 1 for g in groups),
        **structure(graph),
        **map_structure(graph, occupancy, robot_radius),
        **(_on_stairs(graph, occupancy, edges, edges_robot) if isinstance(occupancy, StoreyMaps) else {}),
    }


def _validity(what: str, suffix: str, judged: Mapping[Any, bool]) -> dict[str, float | int]:
    valid = sum(judged.values())
    low, high = wilson(valid, len(judged))
    name = f"{what}_validity{suffix}"
    figures = {name: _share(valid, len(judged)), f"{name}_low": round(low, 5), f"{name}_high": round(high, 5)}
    return {**figures, f"valid_{what}s{suffix}": valid}


def _coverage_shares(
    graph: NavGraph,
    occupancy: OccupancyMap | StoreyMaps,
    valid: list[str],
    trajectory: NDArray[np.floating],
    reach: float,
    seen: SupportAt | None,
) -> dict[str, float]:
    """The coverage by the `valid` viewpoints of the reachable area, and of the part of it that is `seen`."""
    if isinstance(occupancy, StoreyMaps):
        whole, shown = covered_areas(graph, occupancy, valid, trajectory, reach, seen)
        known = {"coverage_seen": _share(*shown), "seen_m2": round(shown[1], 2)} if seen is not None else {}
        return {"coverage": _share(*whole), **known, "reachable_m2": round(whole[1], 2)}
    area = reachable(occupancy, trajectory[:, :2])
    covered = visible(occupancy, _places(graph, valid), reach) & area
    return {
        "coverage": _share(int(covered.sum()), int(area.sum())),
        **(_seen_coverage(covered, area & seen(occupancy.centers()), occupancy) if seen is not None else {}),
        "reachable_m2": _square_meters(area, occupancy),
    }


def _seen_coverage(covered: NDArray[np.bool_], known: NDArray[np.bool_], occupancy: OccupancyMap) -> dict[str, float]:
    shown = int((covered & known).sum())
    return {"coverage_seen": _share(shown, int(known.sum())), "seen_m2": _square_meters(known, occupancy)}


def _on_stairs(
    graph: NavGraph, maps: StoreyMaps, edges: dict[tuple[str, str], bool], edges_robot: dict[tuple[str, str], bool]
) -> dict[str, float | int]:
    between = edges_between_storeys(graph, maps, list(edges))
    return {
        "storeys": len(maps.storeys),
        "stair_edges": len(between),
        **_validity("stair_edge", "", {key: edges[key] for key in between}),
        **_validity("stair_edge", "_robot", {key: edges_robot[key] for key in between}),
    }


def _square_meters(cells: NDArray[np.bool_], occupancy: OccupancyMap) -> float:
    return round(float(cells.sum()) * occupancy.resolution**2, 2)


def _places(graph: NavGraph, ids: list[str]) -> NDArray[np.float64]:
    return np.array([graph.viewpoints[id].position[:2] for id in ids], np.float64).reshape(-1, 2)


def _share(part: float, whole: float) -> float:
    return round(part / whole, 5) if whole else 0.0
