"""Divide a scene into the submaps of a project: one per storey, and one per stair between two storeys.

A stair is the path between two storeys over horizontal surfaces that climbs in small steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.floor_height import stair_floor
from nvsim.scene_import.levels import Level, Storeys, standing_points
from nvsim.scene_import.surface_points import SurfacePoints
from nvsim.splats.types import Gaussians

_LINKS = ((0.24, 0.25, 0.1), (0.45, 0.5, 0.15), (0.5, 0.8, 0.2))
"""Meters that one step climbs, and between surfaces that it connects, seen from above, at most; and side of the cells
in which points are one surface. Later rows cross treads that the splats do not show, and are used if the earlier fail.
"""
_OFF_FLOOR, _SHARE = 0.3, 0.7  # treads are more meters above the lower floor, and below this share of the rise
_AROUND = 2.0  # meters around treads in which the floors belong to the search
_LANDING = 0.7  # meters of floor before and behind the stairs that belong to the path
_SPACING = 0.25  # meters between the places of the path
_SMOOTH = 7  # places over which heights are averaged
_NARROW = 8.0  # cost of a path at the edge of the treads, relative to its middle


def find_stairs(surface: SurfacePoints, lower: Level, upper: Level) -> NDArray[np.float64]:
    """(N, 3) meters: floor places along the stairs from the lower to the upper storey; (0, 3) if there are none."""
    from scipy.spatial import cKDTree

    none = np.zeros((0, 3))
    points = standing_points(surface)
    points = points[(points[:, 2] > lower.height - 0.15) & (points[:, 2] < upper.height + 0.15)]
    top = lower.height + _SHARE * (upper.height - lower.height)  # below the ceiling
    between = (points[:, 2] > lower.height + _OFF_FLOOR) & (points[:, 2] < top)
    if between.sum() < 20:
        return none
    near, _ = cKDTree(points[between][:, :2]).query(points[:, :2], distance_upper_bound=_AROUND)
    points = points[near < _AROUND]
    for step, stride, cell in _LINKS:
        path = _path_up(points, lower, upper, top, np.array([stride, stride, step]), cell)
        if len(path):
            return path
    return none


def _path_up(
    points: NDArray[np.float64], lower: Level, upper: Level, top: float, link: NDArray[np.float64], cell: float
) -> NDArray[np.float64]:
    """(N, 3) the path over `points` (N, 3) from the lower to the upper storey, whose links are at most as long as
    `link` (3,) along each axis; (0, 3) if there is none. Treads are below `top`. All in meters."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra
    from scipy.spatial import cKDTree

    none = np.zeros((0, 3))
    cells = np.floor(points / (cell, cell, cell / 2)).astype(np.int64)
    _, first = np.unique(cells, axis=0, return_index=True)
    nodes = points[np.sort(first)]
    treads = (nodes[:, 2] > lower.height + _OFF_FLOOR) & (nodes[:, 2] < top)
    pairs = cKDTree(nodes / link).query_pairs(1.0, p=np.inf, output_type="ndarray")
    if not len(pairs) or not treads.any():
        return none
    apart = np.linalg.norm(np.diff(nodes[pairs], axis=1)[:, 0], axis=1)
    apart *= np.maximum(1.0, apart / _LINKS[0][1])  # over many treads rather than across a gap
    wide = nodes / (2 * link)
    around = cKDTree(wide).query_ball_point(wide, 1.0, p=np.inf, return_length=True).astype(np.float64)
    around /= np.percentile(around, 90)
    cost = apart * (1 + _NARROW * np.clip(1 - around[pairs].min(axis=1), 0, 1))
    graph = coo_matrix((cost, (pairs[:, 0], pairs[:, 1])), shape=(len(nodes), len(nodes))).tocsr()
    off, _ = cKDTree(nodes[treads][:, :2]).query(nodes[:, :2])
    starts, ends = (
        np.flatnonzero((np.abs(nodes[:, 2] - level.height) < 0.1) & (off > _LANDING) & _is_free(level, nodes))
        for level in (lower, upper)
    )
    if not len(starts) or not len(ends):
        return none
    length, before, _ = dijkstra(graph, directed=False, indices=starts, min_only=True, return_predecessors=True)
    end = int(ends[np.argmin(length[ends])])
    if not np.isfinite(length[end]):
        return none
    path = [end]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return _resample_path(nodes[path[::-1]])


def _is_free(level: Level, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    cells = level.grid.cells_of(points)
    inside = ((cells >= 0) & (cells < level.free.shape)).all(axis=1)
    found = np.zeros(len(points), bool)
    found[inside] = level.free[cells[inside, 0], cells[inside, 1]]
    return found


def _resample_path(path: NDArray[np.float64]) -> NDArray[np.float64]:
    """The path (N, 3) with equal distances and without the corners of treads."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1))])
    count = max(_SMOOTH, round(float(along[-1]) / _SPACING) + 1)
    even = np.stack([np.interp(np.linspace(0, along[-1], count), along, path[:, k]) for k in range(3)], axis=1)
    half = _SMOOTH // 2
    padded = np.pad(even, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    return np.stack([padded[k : k + count] for k in range(_SMOOTH)]).mean(axis=0)


_OVERLAP = 2.0  # meters above and below a storey that belong to its model, for views of stairs
_BESIDE = 6.0  # meters around a stair that belong to its model
_NOSES = 0.1  # meters from the mean slope of a stair to the edges of its treads, which are no obstacles
_OFF = 0.3  # meters from the height of a storey at which a place is on a stair


@dataclass(frozen=True, eq=False)
class ScenePart:
    """A storey, or a stair.

    storeys    the storey, or the two storeys that a stair joins, numbered from 0
    rows       indices of its places among all places of the scene
    surface    its floor
    members    (N,) bool, the Gaussians of the scene that belong to it
    """

    storeys: tuple[int, ...]
    rows: tuple[int, ...]
    surface: FloorSurface
    members: NDArray[np.bool_]


def divide(
    gaussians: Gaussians, surface: SurfacePoints, storeys: Storeys, height: float
) -> tuple[tuple[ScenePart, ...], NDArray[np.float64]]:
    """The parts of a scene, lowest first, and the places (N, 3) meters of viewpoints `height` meters above the floor:
    those of each storey, then those along each stair."""
    levels = storeys.levels
    stairs = [find_stairs(surface, lower, upper) for lower, upper in zip(levels[:-1], levels[1:], strict=True)]
    groups = [level.places for level in levels] + stairs
    firsts = np.cumsum([0, *map(len, groups)])
    places = np.concatenate(groups) + [0.0, 0.0, height]
    rows = [list(range(firsts[k], firsts[k + 1])) for k in range(len(groups))]
    floors = [level.height for level in levels]
    parts: list[ScenePart] = []
    for k, level in enumerate(levels):
        low = -np.inf if k == 0 else floors[k] - _OVERLAP
        high = np.inf if k + 1 == len(floors) else floors[k + 1] + _OVERLAP
        z = gaussians.means[:, 2]
        parts.append(ScenePart((k,), (), level.surface, (z >= low) & (z <= high)))
        if k < len(stairs) and len(stairs[k]):
            own = rows[len(levels) + k]
            steps = [i for i in own if floors[k] + _OFF < places[i, 2] - height < floors[k + 1] - _OFF]
            rows[k] += [i for i in own if places[i, 2] - height <= floors[k] + _OFF]
            rows[k + 1] += [i for i in own if places[i, 2] - height >= floors[k + 1] - _OFF]
            if steps:
                slope = stair_floor(places[own], height - _NOSES)
                near = _is_near(gaussians, stairs[k], floors[k] - _OVERLAP, floors[k + 1] + _OVERLAP)
                parts.append(ScenePart((k, k + 1), tuple(steps), slope, near))
    return tuple(
        ScenePart(p.storeys, p.rows or tuple(sorted(rows[p.storeys[0]])), p.surface, p.members) for p in parts
    ), places


def _is_near(g: Gaussians, path: NDArray[np.float64], low: float, high: float) -> NDArray[np.bool_]:
    corners = path[:, :2].min(axis=0) - _BESIDE, path[:, :2].max(axis=0) + _BESIDE
    inside = ((g.means[:, :2] >= corners[0]) & (g.means[:, :2] <= corners[1])).all(axis=1)
    return np.asarray(inside & (g.means[:, 2] >= low) & (g.means[:, 2] <= high))
