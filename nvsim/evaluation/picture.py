"""Draw a navigation graph on a map as an image."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.evaluation.graph import judge
from nvsim.evaluation.storeys import places_of
from nvsim.files import atomic
from nvsim.graph.types import NavGraph
from nvsim.occupancy.storeys import StoreyMaps
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap

# BGR
_STATES = {int(FREE): (252, 252, 252), int(OCCUPIED): (70, 70, 70), int(UNKNOWN): (214, 214, 214)}
_WALK, _EDGE, _MERGE, _NODE, _START, _BAD = (
    (200, 170, 90),
    (90, 140, 60),
    (150, 110, 160),
    (60, 100, 30),
    (20, 140, 230),
    (40, 40, 220),
)


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
    import cv2

    judged = judge(graph, occupancy) if occupancy is not None else ({}, {})
    if isinstance(occupancy, StoreyMaps):
        side = longest_side // len(occupancy.storeys)
        floors = places_of(graph, list(graph.viewpoints))[1]
        storeys = dict(zip(graph.viewpoints, occupancy.nearest(floors).tolist(), strict=True))
        walked = occupancy.beneath(trajectory[:, 2])
        drawn = []
        for k, storey in enumerate(occupancy.storeys):
            here = NavGraph(
                graph.scan,
                {id: v for id, v in graph.viewpoints.items() if storeys[id] == k},
                {key: e for key, e in graph.edges.items() if k in (storeys[key[0]], storeys[key[1]])},
            )
            drawn.append(_drawn(graph, here, judged, storey.occupancy, trajectory[walked == k], side))
        tallest = max(p.shape[0] for p in drawn)
        grey = _STATES[int(UNKNOWN)]
        picture = np.concatenate(
            [cv2.copyMakeBorder(p, 0, tallest - len(p), 0, 8, cv2.BORDER_CONSTANT, value=grey) for p in drawn], axis=1
        )
    else:
        picture = _drawn(graph, graph, judged, occupancy, trajectory, longest_side)
    try:
        done, data = cv2.imencode(path.suffix or ".png", picture)
    except cv2.error:
        done, data = False, None
    if not done or data is None:
        raise InputError(f"{path} does not have the suffix of an image; name a .png file.")
    atomic.write_bytes(path, data.tobytes())
    return path


def _drawn(
    graph: NavGraph,
    shown: NavGraph,
    judged: tuple[dict[str, bool], dict[tuple[str, str], bool]],
    occupancy: OccupancyMap | None,
    trajectory: NDArray[np.floating],
    longest_side: int,
) -> NDArray[np.uint8]:
    """(H, W, 3) BGR: the viewpoints and edges of `shown` on a map. Their edges may end at other viewpoints of
    `graph`."""
    import cv2

    nodes, edges = judged
    walk = np.asarray(trajectory, np.float64)[:, :2]
    places = np.array([v.position[:2] for v in shown.viewpoints.values()], np.float64).reshape(-1, 2)
    low, high = _extent(occupancy, np.concatenate([walk, places]))
    scale = longest_side / float((high - low).max())
    width, height = np.maximum(np.ceil((high - low) * scale), 1).astype(int)
    picture = np.full((height, width, 3), _STATES[int(UNKNOWN)], np.uint8)
    if occupancy is not None:
        x = low[0] + (np.arange(width) + 0.5) / scale
        y = high[1] - (np.arange(height) + 0.5) / scale
        table = np.zeros((256, 3), np.uint8)
        for state, colour in _STATES.items():
            table[state] = colour
        picture = np.ascontiguousarray(table[occupancy.at(np.stack(np.meshgrid(x, y), axis=-1))])

    def at(xy: NDArray[np.float64] | tuple[float, ...]) -> tuple[int, int]:
        # Sixteenths of a pixel, for a `shift` of 4 in cv2.
        return round((xy[0] - low[0]) * scale * 16), round((high[1] - xy[1]) * scale * 16)

    size = max(1.0, scale * 0.02)
    for a, b in zip(walk[:-1], walk[1:], strict=True):
        if np.hypot(*(a - b)) < 2.0:
            cv2.line(picture, at(a), at(b), _WALK, max(1, round(size)), cv2.LINE_AA, 4)
    for key, edge in shown.edges.items():
        a, b = (graph.viewpoints[id].position for id in key)
        colour = _BAD if edges.get(key) is False else _MERGE if edge.origin == "merge" else _EDGE
        cv2.line(picture, at(a), at(b), colour, max(1, round(1.5 * size)), cv2.LINE_AA, 4)
    for id, v in shown.viewpoints.items():
        colour = _BAD if nodes.get(id) is False else _START if v.origin == "start" else _NODE
        cv2.circle(picture, at(v.position), round(5 * size * 16), colour, -1 if v.included else 1, cv2.LINE_AA, 4)
    return picture


def _extent(
    occupancy: OccupancyMap | None, points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper corner (2,) of the drawn area: the known part of the map and all points, with a margin."""
    boxes = [points] if len(points) else []
    if occupancy is not None:
        rows, columns = np.nonzero(occupancy.cells != UNKNOWN)
        if len(rows):
            index = np.stack([columns, rows], axis=-1)
            corners = np.stack([index.min(axis=0), index.max(axis=0) + 1]) * occupancy.resolution
            boxes.append(corners + np.array(occupancy.origin))
    if not boxes:
        return np.zeros(2), np.ones(2)
    everything = np.concatenate(boxes)
    return everything.min(axis=0) - 0.5, everything.max(axis=0) + 0.5
