"""The collision mesh of a scan: the floor on which robots stand, and the sides of obstacles, from its free space.

Walls and furniture have sides up to HEIGHT above the floor and no tops, so nothing can stand on them. Steps on stairs
are ramps along the edges of the graph.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.dataset.habitat.surface import SolidColumns
from nvsim.graph.quantities import slope_of
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.r2r.episodes.episode_actions import scanned_obstacles, visible_floor
from nvsim.r2r.surroundings.layers import Layers

HEIGHT = 1.8
"""Meters of the sides of obstacles above the floor."""
_FROM, _TO = 0.1, 1.5  # meters above the floor between which surfaces are obstacles; agents of VLN-CE are 1.5 m high
_RAMP = 0.4  # half the width of a ramp in meters
_VERTICAL = 0.05  # meters between the ends seen from above; such an edge has no ramp
Rectangle = tuple[int, int, int, int]


def collision_mesh(
    graph: NavGraph,
    storeys: Sequence[Layers],
    columns: Sequence[SolidColumns],
    cloud: NDArray[np.floating] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Returns (N, 3) vertices, meters, world, and (M, 3) triangles, counterclockwise seen from free space.

    columns  of each storey, between `obstacle_heights`
    cloud    (N, 3) points on surfaces, meters, world, which become obstacles too, or None
    """
    quads: list[NDArray[np.float64]] = []
    level: set[str] = set()
    for layers, grid in zip(storeys, columns, strict=True):
        level |= {one.viewpoint.id for one in layers.seen}
        places, blocked = grid.places(), grid.solid
        if cloud is not None:
            blocked = blocked | layers.values_at(scanned_obstacles(layers, cloud), places)
        floor = _reached(layers.values_at(visible_floor(layers), places) & ~blocked, layers, grid)
        quads += [_flat(grid, one, layers.floor) for one in rectangles(floor)]
        for one in rectangles(_obstacles_beside_floor(blocked, floor)):
            quads += list(_sides(grid, one, layers.floor))
    for a, b in graph.edges:
        ends = graph.viewpoints[a], graph.viewpoints[b]
        if math.dist(ends[0].position[:2], ends[1].position[:2]) < _VERTICAL:
            continue
        if a not in level or b not in level or not _is_level(*ends):
            quads.append(_ramp(*ends))
    vertices = np.concatenate(quads) if quads else np.zeros((0, 3))
    first = np.arange(0, len(vertices), 4)[:, None]
    return vertices, np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])


def obstacle_heights(layers: Layers) -> tuple[float, float]:
    """Returns world z between which surfaces of a storey are obstacles, in meters."""
    return layers.floor + _FROM, layers.floor + _TO


def rectangles(mask: NDArray[np.bool_]) -> Iterator[Rectangle]:
    """Yields disjoint rectangles (first row, end row, first column, end column) that cover the cells of a mask.

    Equal runs of consecutive rows become one rectangle.
    """
    growing: dict[tuple[int, int], int] = {}
    for row in range(mask.shape[0] + 1):
        line = np.zeros(mask.shape[1] + 2, np.int8)
        if row < mask.shape[0]:
            line[1:-1] = mask[row]
        changes = np.flatnonzero(np.diff(line))
        runs = set(zip(changes[::2].tolist(), changes[1::2].tolist()))
        for run in [run for run in growing if run not in runs]:
            yield growing.pop(run), row, *run
        for run in runs:
            growing.setdefault(run, row)


def _reached(floor: NDArray[np.bool_], layers: Layers, grid: SolidColumns) -> NDArray[np.bool_]:
    """Returns the parts of the floor with a viewpoint; others are seen through windows."""
    import cv2

    _, labels = cv2.connectedComponents(floor.astype(np.uint8), connectivity=4)
    at = grid.values_at(labels, np.array([one.viewpoint.position[:2] for one in layers.seen]))
    return np.isin(labels, at[at > 0])


def _obstacles_beside_floor(blocked: NDArray[np.bool_], floor: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Returns the obstacles that touch the floor; robots do not reach the others."""
    import cv2

    return blocked & cv2.dilate(floor.astype(np.uint8), np.ones((5, 5), np.uint8)).astype(bool)


def _corners(grid: SolidColumns, one: Rectangle) -> NDArray[np.float64]:
    """Returns (4, 2) the corners of a rectangle, meters, counterclockwise from above."""
    top, bottom, left, right = one
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]]) * grid.voxel + (
        np.array(grid.low) - grid.voxel / 2
    )


def _flat(grid: SolidColumns, one: Rectangle, z: float) -> NDArray[np.float64]:
    return np.column_stack([_corners(grid, one), np.full(4, z)])


def _sides(grid: SolidColumns, one: Rectangle, low: float) -> Iterator[NDArray[np.float64]]:
    corners, high = _corners(grid, one), low + HEIGHT
    for a, b in zip(corners, np.roll(corners, -1, axis=0)):
        yield np.array([[*a, low], [*b, low], [*b, high], [*a, high]])


def _is_level(a: Viewpoint, b: Viewpoint) -> bool:
    way = np.subtract(b.position, a.position)
    return slope_of(float(way[2]), float(np.linalg.norm(way))) == "level"


def _ramp(a: Viewpoint, b: Viewpoint) -> NDArray[np.float64]:
    """Returns (4, 3) a strip of floor along an edge."""
    start, stop = (np.array([*v.position[:2], v.position[2] - v.height]) for v in (a, b))
    x, y = (stop - start)[:2] / np.linalg.norm((stop - start)[:2])
    across = np.array([y, -x, 0.0]) * _RAMP
    return np.array([start + across, stop + across, stop - across, start - across])
