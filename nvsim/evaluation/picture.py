"""Draw a navigation graph on a map as an image."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.graph import judge, places_of
from nvsim.figures import save_figure
from nvsim.graph.exports.picture import KEYS, TRAJECTORY, LegendRow, MapArea, draw_areas, extent, grouped
from nvsim.graph.types import NavGraph
from nvsim.occupancy.storeys import StoreyMaps
from nvsim.occupancy.types import OccupancyMap

_KEYS = {
    "edge": replace(KEYS["step"], words="edges"),
    **{name: KEYS[name] for name in ("merge", "start", "node")},
    "bad": LegendRow("outside free cells", "#dc2828"),
    "walk": LegendRow("trajectory", TRAJECTORY, ""),
}
_MARGIN = 0.5  # meters


def draw_graph(
    graph: NavGraph,
    occupancy: OccupancyMap | StoreyMaps | None,
    trajectory: NDArray[np.floating],
    path: Path,
    longest_side: int = 1600,
) -> Path:
    """Writes an image (PNG by its suffix) with y upwards: the map, the trajectory (N, 2 or 3) in meters, edges, and
    viewpoints. Edges are green, merge edges violet, viewpoints green, start viewpoints orange. Viewpoints and edges
    outside free cells are red. Without a map nothing is red.

    The storeys of a building are side by side, the lowest on the left, each with its viewpoints and its stairs. Their
    trajectory must be (N, 3). Raises InputError if the disk refuses or the suffix is not one of an image.
    """
    nodes, edges = judge(graph, occupancy) if occupancy is not None else ({}, {})
    groups = grouped(
        _KEYS,
        {
            id: "bad" if nodes.get(id) is False else "start" if v.origin == "start" else "node"
            for id, v in graph.viewpoints.items()
        },
        {
            key: "bad" if edges.get(key) is False else "merge" if edge.origin == "merge" else "edge"
            for key, edge in graph.edges.items()
        },
        "walk" if len(trajectory) > 1 else "",
    )
    if isinstance(occupancy, StoreyMaps):
        floors = places_of(graph, list(graph.viewpoints))[1]
        storeys = dict(zip(graph.viewpoints, occupancy.nearest(floors).tolist(), strict=True))
        walked = occupancy.storey_under(trajectory[:, 2])
        areas = [
            _area(
                graph,
                [id for id, k in storeys.items() if k == number],
                [key for key in graph.edges if number in (storeys[key[0]], storeys[key[1]])],
                storey.occupancy,
                trajectory[walked == number],
            )
            for number, storey in enumerate(occupancy.storeys)
        ]
    else:
        areas = [_area(graph, list(graph.viewpoints), list(graph.edges), occupancy, trajectory)]
    return save_figure(draw_areas(graph, areas, groups, longest_side), path)


def _area(
    graph: NavGraph,
    ids: list[str],
    edges: list[tuple[str, str]],
    occupancy: OccupancyMap | None,
    walk: NDArray[np.floating],
) -> MapArea:
    places = np.array([graph.viewpoints[id].position[:2] for id in ids], np.float64).reshape(-1, 2)
    low, high = extent(occupancy, np.concatenate([walk[:, :2], places]), _MARGIN) or (np.zeros(2), np.ones(2))
    return MapArea(low, high, ids, edges, occupancy, walk)
