"""Compare a navigation graph with the occupancy maps of one or more storeys: validity of nodes and edges, coverage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.interval import wilson
from nvsim.evaluation.storeys import climbing, covered_areas, judge_storeys
from nvsim.evaluation.structure import map_structure
from nvsim.graph.components import components
from nvsim.graph.structure import structure
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import SupportAt
from nvsim.occupancy.paths import points_are_free, reachable, segments_are_free, standing_room, visible
from nvsim.occupancy.storeys import StoreyMaps
from nvsim.occupancy.types import OccupancyMap


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
    area. `seen` tells whether the capture shows floor at world x, y (..., 2), such as `FloorSupport.at`. With maps of
    several storeys both need heights: `trajectory` (N, 3) of the cameras, and `seen` at (..., 3).

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
    around = _covered(graph, occupancy, valid, trajectory, coverage_range, seen)
    shares = {id: share for id in nodes if (share := graph.viewpoints[id].photographed) is not None}
    if shares:
        hazy = {id for id, share in shares.items() if share < photographed}
        rest = _covered(graph, occupancy, [id for id in valid if id not in hazy], trajectory, coverage_range, seen)
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


def _covered(
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
        **(_seen(covered, area & seen(occupancy.centres()), occupancy) if seen is not None else {}),
        "reachable_m2": _square_metres(area, occupancy),
    }


def _seen(covered: NDArray[np.bool_], known: NDArray[np.bool_], occupancy: OccupancyMap) -> dict[str, float]:
    shown = int((covered & known).sum())
    return {"coverage_seen": _share(shown, int(known.sum())), "seen_m2": _square_metres(known, occupancy)}


def _on_stairs(
    graph: NavGraph, maps: StoreyMaps, edges: dict[tuple[str, str], bool], edges_robot: dict[tuple[str, str], bool]
) -> dict[str, float | int]:
    between = climbing(graph, maps, list(edges))
    return {
        "storeys": len(maps.storeys),
        "stair_edges": len(between),
        **_validity("stair_edge", "", {key: edges[key] for key in between}),
        **_validity("stair_edge", "_robot", {key: edges_robot[key] for key in between}),
    }


def _square_metres(cells: NDArray[np.bool_], occupancy: OccupancyMap) -> float:
    return round(float(cells.sum()) * occupancy.resolution**2, 2)


def _places(graph: NavGraph, ids: list[str]) -> NDArray[np.float64]:
    return np.array([graph.viewpoints[id].position[:2] for id in ids], np.float64).reshape(-1, 2)


def _share(part: float, whole: float) -> float:
    return round(part / whole, 5) if whole else 0.0
