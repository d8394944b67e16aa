"""A navigation graph against an occupancy map or those of several storeys: validity of nodes and edges, coverage."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.storeys import climbing, judge_storeys, seen_area
from nvsim.graph.components import components
from nvsim.graph.types import NavGraph
from nvsim.occupancy.paths import points_are_free, reachable, segments_are_free, standing_room, visible
from nvsim.occupancy.storeys import StoreyMaps
from nvsim.occupancy.types import OccupancyMap


def judge(
    graph: NavGraph, occupancy: OccupancyMap | StoreyMaps, radius: float = 0.0
) -> tuple[dict[str, bool], dict[tuple[str, str], bool]]:
    """Which included viewpoints stand, and which edges between them run, where a disc of `radius` metres touches free
    cells only. Unknown cells are not free. On the maps of several storeys as `judge_storeys` says."""
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
) -> dict[str, Any]:
    """Figures of `graph` on `occupancy`, both in one frame; `trajectory` (N, 2) says what could be reached at all; on
    the maps of several storeys it must be (N, 3), of the cameras.

    nodes, edges                   included viewpoints, and edges between them
    node_validity, edge_validity   share on free cells, for a point; _robot for a disc of `robot_radius` metres
    coverage                       share of the free area reachable from the trajectory, for a point, that lies within
                                   `coverage_range` metres and in line of sight of a valid viewpoint
    reachable_m2, components, largest_component (share of the nodes), isolated, mean_degree, edge_length
    Of several storeys, coverage is over all of them, and there are
    storeys                        their number
    stair_edges, stair_edge_validity, stair_edge_validity_robot: of the edges from one storey to another
    Shares are 0 to 1; of nothing they are 0.
    """
    nodes, edges = judge(graph, occupancy)
    nodes_robot, edges_robot = judge(graph, occupancy, robot_radius)
    valid = [id for id, good in nodes.items() if good]
    stairs: dict[str, Any] = {}
    if isinstance(occupancy, StoreyMaps):
        area, seen = seen_area(graph, occupancy, valid, trajectory, coverage_range)
        coverage = _share(seen, area)
        between = climbing(graph, occupancy, list(edges))
        stairs = {
            "storeys": len(occupancy.storeys),
            "stair_edges": len(between),
            "stair_edge_validity": _share(sum(edges[key] for key in between), len(between)),
            "stair_edge_validity_robot": _share(sum(edges_robot[key] for key in between), len(between)),
        }
    else:
        cells = reachable(occupancy, trajectory[:, :2])
        found = visible(occupancy, _places(graph, valid), coverage_range) & cells
        area, coverage = float(cells.sum()) * occupancy.resolution**2, _share(int(found.sum()), int(cells.sum()))
    groups = components(graph)
    places = {side: _places(graph, [key[side] for key in edges]) for side in (0, 1)}
    lengths = np.hypot(*(places[0] - places[1]).T)
    return {
        "nodes": len(nodes),
        "edges": len(edges),
        "node_validity": _share(sum(nodes.values()), len(nodes)),
        "edge_validity": _share(sum(edges.values()), len(edges)),
        "node_validity_robot": _share(sum(nodes_robot.values()), len(nodes)),
        "edge_validity_robot": _share(sum(edges_robot.values()), len(edges)),
        "coverage": coverage,
        "reachable_m2": round(area, 2),
        "components": len(groups),
        "largest_component": _share(len(groups[0]) if groups else 0, len(nodes)),
        "isolated": sum(len(g) == 1 for g in groups),
        "mean_degree": round(2 * _share(len(edges), len(nodes)), 2),
        "edge_length": round(float(lengths.mean()), 3) if len(lengths) else 0.0,
        **stairs,
    }


def _places(graph: NavGraph, ids: list[str]) -> NDArray[np.float64]:
    return np.array([graph.viewpoints[id].position[:2] for id in ids], np.float64).reshape(-1, 2)


def _share(part: float, whole: float) -> float:
    return round(part / whole, 5) if whole else 0.0
