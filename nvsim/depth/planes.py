"""Find the planes of a building in the point cloud of its depth maps: floors, ceilings, and walls with their extent.

Only vertical and horizontal planes are searched. Bare surfaces of buildings are such planes, and the point cloud
contains their borders.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.depth.fusion import ObservedPoints, normals_of
from nvsim.depth.view import matrix_of
from nvsim.geometry.camera import Camera
from nvsim.geometry.cells import distinct_cells

Float64 = NDArray[np.float64]


_FEW = 40  # points of a patch
_EDGE = 0.03  # meters that a wall may extend into its floor and its ceiling, about the size of a pixel


_COARSE = 0.05  # meters: cell size to which the point cloud is thinned
_TURNED = 25.0  # degrees between the normals of a plane and its points, at most
_THICKNESS = 0.05  # meters: largest distance from a plane to its points
_SCATTER = 0.12  # meters: points nearer to a plane form no further plane
_CELL = 0.2  # meters: cell size of the extent of a plane
_GAP = 4  # cells without points that a patch may span
_SMALLEST = 0.5  # square meters of cells with points, at least
_MARGIN = 0.4  # meters that a patch extends beyond its points
_INSIDE = 0.15  # meters that points of a wall may be below its floor or above its ceiling
_FLOOR = 4.0  # square meters from which a horizontal patch is an opaque floor or ceiling
_RAISED = 0.25, 1.2  # least and greatest meters of a table, a counter, or a bed above the floor
_LOWER = 0.2  # share of the area of a level patch from which a patch under it is the floor, and the upper one furniture
_THROUGH = 0.08  # meters: points farther below a floor are reflections, because glossy floors mirror the room
_SAY = 1e4  # 1 / meters squared: points with a smaller inverse variance are ignored
_MOST = 1e6  # 1 / meters squared: upper limit of the weight of a cell
_LEAST = 0.05  # share of the smallest plane's cells that points of the highest weight would have to fill
_LAYER = 0.15  # share of the weight of a patch's strongest layer from which a layer behind it is the wall
_BEFORE = 0.3  # weight of a point in front of a wall (pictures, screens, cupboards) relative to one behind it


@dataclass(frozen=True, eq=False)
class Plane:
    """A patch of the plane of world points p with normal @ p = offset, in meters.

    `along` and `up` (3,) are its axes; `low` and `high` (2,) its extent along them, meters. `area` is the area of cells
    with points, square meters. `cells` (A, B) bool are these cells with small gaps closed, of `cell` meters, starting
    at `corner` (2,)."""

    normal: Float64
    offset: float
    along: Float64
    up: Float64
    low: Float64
    high: Float64
    area: float
    cells: NDArray[np.bool_]
    corner: Float64
    cell: float

    def in_pixels(self, camera: Camera) -> Float64:
        """(3,) a, b, c: a * x + b * y + c is the inverse depth of the plane at pixel index (x, y), 1 / meters.

        It is not positive where the plane is not in front of the camera."""
        distance = self.offset - self.normal @ camera.position
        if abs(distance) < 1e-6:
            return np.zeros(3)
        return np.asarray((self.normal @ camera.rotation @ np.linalg.inv(matrix_of(camera))) / distance)


def is_behind_floor(planes: list[Plane], eyes: Float64, points: Float64) -> NDArray[np.bool_]:
    """(N,) bool, True for world points (N, 3) behind a floor, seen from `eyes` (N, 3) or (3,), meters. Such points are
    reflections in the floor."""
    behind = np.zeros(len(points), bool)
    for plane in _floors(planes):
        below, above = plane.offset - points @ plane.normal, eyes @ plane.normal - plane.offset
        may = np.flatnonzero((below > _THROUGH) & (above > 0))
        share = (below / (below + above))[may, None]
        at = points[may] + share * (np.broadcast_to(eyes, points.shape)[may] - points[may])
        index = np.floor((np.stack([at @ plane.along, at @ plane.up], axis=1) - plane.corner) / plane.cell).astype(int)
        inside = np.all((index >= 0) & (index < plane.cells.shape), axis=1)
        index = np.where(inside[:, None], index, 0)
        behind[may] |= inside & plane.cells[index[:, 0], index[:, 1]]
    return behind


def _floors(planes: list[Plane]) -> list[Plane]:
    """The floors among `planes`. A large patch with much level ground under it is the top of furniture. The reflections
    of a room in its floor show a ceiling much farther below, and no tops of tables."""
    level = [p for p in planes if p.normal[2] > 0.9]
    return [p for p in level if p.area >= _FLOOR and not any(_is_ground_under(p, q) for q in level)]


def _is_ground_under(top: Plane, ground: Plane) -> bool:
    """Whether the level patch `ground` is as far under the level patch `top` as a floor under furniture."""
    if (ground.low > top.high).any() or (ground.high < top.low).any():
        return False
    x, y = (top.low + top.high) / 2
    middle = x * top.along + y * top.up
    over = (top.offset - top.normal @ middle) - (ground.offset - ground.normal @ middle)
    return bool(_RAISED[0] < over < _RAISED[1] and ground.area >= _LOWER * top.area)


def find_planes(parts: Iterable[ObservedPoints]) -> list[Plane]:
    """The planes that contain the points of a building, largest first. `parts` are in the order of their `end`."""
    points, eyes, say = _sample_coarse_cells(parts)
    if len(points) < 100:
        return []
    normals = normals_of(points.astype(np.float32), eyes - points, 24).astype(np.float64)
    near = np.cos(np.radians(_TURNED))
    z = np.array([0.0, 0.0, 1.0])
    level: list[Plane] = []
    up = np.flatnonzero(normals @ z > near)
    _parallel(points[up], say[up], z, level)
    free = ~is_behind_floor(level, eyes, points)
    found: list[Plane] = []
    for normal in [z, -z, *_headings(normals[free])]:
        chosen = np.flatnonzero(free & (normals @ normal > near))
        taken = _parallel(points[chosen], say[chosen], normal, found)
        free[chosen[taken]] = False
    return sorted((_crop_plane(plane, found) for plane in found), key=lambda p: -p.area)


def _is_upright(normal: Float64) -> bool:
    """Whether a plane with this normal (3,) is a wall, not a floor or ceiling."""
    return bool(abs(normal[2]) < 0.5)


def _crop_plane(plane: Plane, found: list[Plane]) -> Plane:
    """`plane`, if vertical, cropped where its margin would extend into a floor or a ceiling of `found`."""
    if not _is_upright(plane.normal):
        return plane
    level = [p for p in found if abs(p.normal[2]) > 0.9 and p.area >= _FLOOR]
    low, high, reach = plane.low.copy(), plane.high.copy(), _MARGIN + _INSIDE
    floors = [p.offset for p in level if p.normal[2] > 0 and 0 <= p.offset - low[1] <= reach]
    ceilings = [-p.offset for p in level if p.normal[2] < 0 and 0 <= high[1] + p.offset <= reach]
    low[1] = max(low[1], min(floors, default=-np.inf) - _EDGE)
    high[1] = min(high[1], max(ceilings, default=np.inf) + _EDGE)
    return replace(plane, low=low, high=high)


def _sample_coarse_cells(parts: Iterable[ObservedPoints]) -> tuple[Float64, Float64, Float64]:
    """Point, camera position, and weight of every coarse cell, from points that are accurate enough.

    The coarse cells that a later part can have too stay open: their sums go on with its points."""
    points, eyes, say = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty(0)]
    cells, sums = np.empty((0, 3), np.int64), np.empty((0, 7))
    for seen in parts:
        good = seen.say > _SAY
        weight = seen.say[good].astype(np.float64)
        values = (*seen.points[good].T, *seen.eyes[good].T)
        found = np.floor(seen.points[good] / _COARSE).astype(np.int64)
        cells, index = distinct_cells(np.concatenate([cells, found]))
        columns = (
            *(np.append(sums[:, c], value * weight) for c, value in enumerate(values)),
            np.append(sums[:, 6], weight),
        )
        sums = np.stack([np.bincount(index, column, len(cells)) for column in columns], axis=1)
        ended = cells[:, 0] < seen.end / _COARSE - 2  # rounding may move a point to the cell beside its own
        points.append(sums[ended, :3] / sums[ended, 6:])
        eyes.append(sums[ended, 3:6] / sums[ended, 6:])
        say.append(np.minimum(sums[ended, 6], _MOST))
        cells, sums = cells[~ended], sums[~ended]
    return np.concatenate(points), np.concatenate(eyes), np.concatenate(say)


def _headings(normals: Float64) -> list[Float64]:
    """Horizontal directions of many normals."""
    level = normals[np.abs(normals[:, 2]) < 0.35]
    if not len(level):
        return []
    degree = np.degrees(np.arctan2(level[:, 1], level[:, 0])) % 360
    votes = np.bincount(degree.astype(int), minlength=360).astype(float)
    smooth = sum(np.roll(votes, s) * np.exp(-0.5 * (s / 3.0) ** 2) for s in range(-9, 10))
    assert isinstance(smooth, np.ndarray)
    chosen: list[int] = []
    for peak in np.argsort(-smooth, kind="stable"):
        if smooth[peak] < 0.04 * smooth.max() or len(chosen) == 24:
            break
        if all(min((peak - c) % 360, (c - peak) % 360) > 10 for c in chosen):
            chosen.append(int(peak))
    return [np.array([np.cos(a), np.sin(a), 0.0]) for a in np.radians(np.array(chosen) + 0.5)]


def _parallel(points: Float64, say: Float64, normal: Float64, found: list[Plane]) -> NDArray[np.bool_]:
    """Find the patches perpendicular to `normal` among points (N, 3) with weights `say` (N,), and add them to `found`.
    Returns (N,) bool, True for the points that they contain."""
    from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter1d, label

    taken = np.zeros(len(points), bool)
    if len(points) < 50:
        return taken
    along = np.array([-normal[1], normal[0], 0.0]) if _is_upright(normal) else np.array([1.0, 0.0, 0.0])
    up = np.cross(normal, along)
    plane = np.stack([points @ along, points @ up], axis=1)
    height = points @ normal
    step = 0.02
    base = height.min() - 5 * step
    for _ in range(200):
        free = ~taken
        votes = np.bincount(
            ((height[free] - base) / step).astype(int),
            say[free] / _MOST,
            minlength=int(np.ptp(height) / step) + 12,
        )
        smooth = gaussian_filter1d(votes, 1.5)
        peak = int(smooth.argmax())
        least = _SMALLEST / _COARSE**2 * _LEAST
        if smooth[peak] * 3.8 < least:
            break
        center = base + (peak + 0.5) * step
        close = np.flatnonzero(free & (np.abs(height - center) < _THICKNESS))
        around = np.flatnonzero(free & (np.abs(height - center) < _SCATTER))
        taken[around] = True
        corner = plane[close].min(axis=0)
        cell = np.floor((plane[close] - corner) / _CELL).astype(int)
        grid = np.zeros(cell.max(axis=0) + 1, bool)
        np.logical_or.at(grid, (cell[:, 0], cell[:, 1]), True)
        side = 2 * (_GAP // 2) + 1
        wide = binary_dilation(grid, np.ones((side, side), bool))
        parts, count = label(wide)
        closed = binary_erosion(wide, np.ones((side, side), bool), border_value=1)
        member = parts[cell[:, 0], cell[:, 1]]
        for part in range(1, count + 1):
            area = float((grid & (parts == part)).sum() * _CELL**2)
            rows = close[member == part]
            if area < _SMALLEST or len(rows) < _FEW:
                continue
            extent = (area, closed & (parts == part), corner)
            if _is_upright(normal):
                at = np.floor((plane[around] - corner) / _CELL).astype(int)
                inside = np.all((at >= 0) & (at < grid.shape), axis=1)
                inside[inside] = (parts == part)[at[inside, 0], at[inside, 1]]
                own = around[inside]
                back = np.abs(height[own] - _wall_position(height[own], say[own])) < _THICKNESS
                rows = own[back] if back.sum() >= _FEW else rows
            found.append(_fit_plane(points[rows], say[rows], normal, along, up, extent))
    return taken


def _wall_position(height: Float64, say: Float64) -> float:
    """The position of a wall along its normal, from the `height` (N,) of its points and their weights `say` (N,).

    Points in front of and behind the wall form layers. The wall is the hindmost layer with enough weight."""
    from scipy.ndimage import gaussian_filter1d

    step = 0.01
    base = float(height.min()) - 5 * step
    votes = np.bincount(((height - base) / step).astype(int), say, minlength=int(np.ptp(height) / step) + 12)
    smooth = gaussian_filter1d(votes, 1.5, mode="constant")
    strong = (smooth >= _LAYER * smooth.max()) & (smooth >= np.roll(smooth, 1)) & (smooth > np.roll(smooth, -1))
    return base + (int(strong.argmax()) + 0.5) * step


def _fit_plane(
    points: Float64,
    say: Float64,
    normal: Float64,
    along: Float64,
    up: Float64,
    extent: tuple[float, NDArray[np.bool_], Float64],
) -> Plane:
    """The plane through points (N, 3) with weights `say` (N,), tilted by a few degrees from `normal` if the points
    support it. `extent` is its area, its cells, and their corner."""
    share = say / say.mean()
    middle = np.average(points, axis=0, weights=say)
    local = points - middle
    a, b, h = local @ along, local @ up, local @ normal
    weight = share
    slope = np.zeros(3)
    for _ in range(8):
        design = np.stack([a, b, np.ones_like(a)], axis=1)
        # A narrow patch has no information about its slope across.
        normal_matrix = design.T @ (design * weight[:, None]) + np.diag([0.5, 0.5, 0.0]) * len(h) * 0.05
        slope = np.linalg.solve(normal_matrix, design.T @ (weight * h))
        off = h - design @ slope
        scale = max(1.5 * float(np.median(np.abs(off))), 0.005)
        weight = share / (1 + (off / (2 * scale)) ** 2) ** 2
        if _is_upright(normal):
            weight *= np.where(off > 0, _BEFORE, 1.0)
    turned = normal - slope[0] * along - slope[1] * up
    turned /= np.linalg.norm(turned)
    offset = float(turned @ (middle + slope[2] * normal))
    flat = np.stack([points @ along, points @ up], axis=1)
    low, high = np.percentile(flat, 0.5, axis=0) - _MARGIN, np.percentile(flat, 99.5, axis=0) + _MARGIN
    area, cells, corner = extent
    return Plane(turned, offset, along, up, low, high, area, cells, corner, _CELL)
