"""The height of the floor around a trajectory, from the points below the cameras. The trajectory gives the floor height
to within a few decimeters; the point cloud refines it to within a centimeter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.geometry.cells import distinct_cells, grid_size
from nvsim.geometry.floor_surface import FloorSurface

Float64 = NDArray[np.float64]


_SPACING = 1.0  # meters between the nodes of the height grid
_MARGIN = 8.0  # meters that the grid extends beyond the trajectory
_LOWEST, _HIGHEST = 0.15, 2.6  # meters: least and greatest height of a camera above its floor
_WINDOW = 0.25  # meters: points this close to the expected floor can correct it
_REACH = 8.0  # meters: the cloud corrects the floor within this distance of the trajectory
_STIFFNESS = 2.0  # weight of smoothness relative to one patch of floor points
_PATCH = 0.25  # meters: floor points are reduced to one median per patch, so that dense places do not dominate
_TOLERATED = 0.05  # meters: floor points this far from the floor of their neighbors lose most of their weight
_MOST_HEIGHTS = 250_000  # nodes; a fit over more needs gigabytes
_MOST_POINTS = 1_000_000  # about those of 400 square meters
_LEVEL = 0.02  # meters: bin width of the height histograms
_TREAD, _SUPPLE = 0.25, 0.005  # meters between the nodes, and stiffness, of the slope of a staircase
_UNDER = 0.2  # meters: points this far under a level are not its noise
_FEW, _MANY = 0.05, 0.15  # shares of the patches under a level: up to 0.02 for floors, 0.08 to 0.6 for tables and beds
_NEAR, _SEVERAL = 1.0, 0.07  # meters below the cameras: a level this near is seldom the floor; then fewer are too many
_DEEPER = 0.1  # meters: a clear level this far under the lowest strong one is the floor below stray points
_AREA, _CLEAR = 0.05, 1.5  # share of the patches on a floor; times as many as just above it, where walls are uniform
_PEAKED, _WIDE = 2.5, 0.12  # times the mean of all heights that floor has; least meters of a window where this shows
_SLAB = 0.12, 0.5  # least and greatest meters from a ceiling to the floor above it


def estimate_floor(
    cloud: Cloud | None,
    positions: NDArray[np.floating],
    camera_height: float | None = None,
    above_another: bool = False,
) -> FloorSurface:
    """The floor below a trajectory with camera positions (N, 3), meters, z up.

    The camera height is the lowest level below the cameras that many cameras share, near `camera_height` meters if that
    is given. Camera positions minus that height give a first floor. The dominant level of the cloud near it then
    corrects it patch by patch, if the level continues that of neighboring patches. So the floor follows ramps. Tables
    are too far above the expected floor to be considered. Between and beyond the patches the surface is smooth. Set
    `above_another` if a storey is below, so that its ceiling is not mistaken for this floor.

    Raises InputError if no frame has a pose, if neither the cloud nor `camera_height` gives the camera height, or if
    furniture hides the floor.
    """
    walk = np.asarray(positions, np.float64).reshape(-1, 3)
    if len(walk) == 0:
        raise InputError("The capture has no frame with a pose, so NVSim cannot find the floor; check the capture.")
    points = _possible_floor_points(cloud, walk)
    found = None if points is None else _carried_height(points, walk, camera_height, above_another)
    height = found if found is not None else camera_height
    if height is None:
        raise InputError(
            "The cloud shows no floor below the cameras and the camera height is not given; "
            "give the height of the camera above the floor in meters (--camera-height)."
        )
    trusted = camera_height is not None and (cloud is None or not cloud.is_dense)
    if trusted and camera_height is not None:
        height = camera_height
    grid = _Grid.around(walk, _SPACING)
    below = walk - np.array([0.0, 0.0, height])
    # Hand-held cameras bob by a few centimeters and floors do not: without a cloud the fit is stiff.
    surface = expected = grid.fit(below, np.ones(len(below)), _STIFFNESS * (20 if trusted else 1))
    if points is None or found is None:
        return surface
    # Coarse rounds first, then fine ones: each moves the expected floor toward the level that the cloud shows.
    for window in (0.1, 0.06) if trusted else (_WINDOW, _WINDOW, _WINDOW, 0.12, 0.12, 0.06):
        patches = _patches(points, surface, window, min(window, _SLAB[0]) if above_another else window)
        if len(patches) == 0:
            break
        xyz = np.concatenate([patches, below])
        # Geman-McClure weights: a 15 cm step beside the trajectory is ignored; a ramp is followed patch by patch.
        off = patches[:, 2] - surface.height_at(patches[:, :2])
        agreement = 1.0 / (1.0 + (off / _TOLERATED) ** 2) ** 2
        weight = np.concatenate([agreement, np.full(len(below), 0.02)])
        surface = grid.fit(xyz, weight, _STIFFNESS)
    if trusted and np.abs(surface.height_at(walk[:, :2]) - expected.height_at(walk[:, :2])).max() > 0.12:
        return expected  # a sparse cloud can refine a given height, not replace it
    return surface


def _possible_floor_points(cloud: Cloud | None, walk: Float64) -> Float64 | None:
    """Points of the cloud that can be floor of this trajectory: near it and below the nearest camera. None if there are
    too few."""
    if cloud is None or len(cloud.points) == 0:
        return None
    from scipy.spatial import cKDTree

    low, high = walk.min(axis=0) - _REACH, walk.max(axis=0) + _REACH
    x, y = cloud.points[:, 0], cloud.points[:, 1]
    around = np.flatnonzero((x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]))
    # An even subset shows the height of the floor as well as all points.
    points = np.asarray(cloud.points[around[:: -(-len(around) // _MOST_POINTS) or 1]], np.float64)
    cells, member = distinct_cells(np.floor(points[:, :2] / _PATCH).astype(np.int64))
    distance, nearest = cKDTree(walk[:, :2]).query((cells + 0.5) * _PATCH, distance_upper_bound=_REACH)
    carried = np.append(walk[:, 2], np.nan)[nearest][member]
    drop = carried - points[:, 2]
    slack = 0.1 * np.append(distance, 0.0)[member]
    points = points[(drop > _LOWEST - slack) & (drop < _HIGHEST + slack)]
    return points if len(points) >= 30 else None


def _carried_height(points: Float64, walk: Float64, camera_height: float | None, above_another: bool) -> float | None:
    """The camera height above the floor: the lowest level below the cameras that a large share of them have.

    Every camera votes with the heights of the points within 1.2 m of it, each height once per patch. A table is below
    only a few cameras and above the floor, so the floor is the lowest of the strong levels. If furniture fills the
    images, its level is the strongest one, but many points are under it. The floor is then the strongest level with few
    points under it. A given `camera_height` limits the levels to within 20 % of it. If the storey is `above_another`,
    the lowest level can be a ceiling. The result is then the strong level above it by the thickness of a floor. None if
    no level is dominant. Raises InputError if furniture hides the floor and no lower level is clear.
    """
    from scipy.spatial import cKDTree

    chosen = walk[np.linspace(0, len(walk) - 1, min(len(walk), 400)).astype(int)]
    size = np.array([_PATCH, _PATCH, _LEVEL])
    cells, member = distinct_cells(np.floor(points / size).astype(np.int64))
    patches = (cells + 0.5) * size
    tree = cKDTree(patches[:, :2])
    bins = int(np.ceil((_HIGHEST + 0.4) / _LEVEL))
    votes = np.zeros(bins)
    for camera, near in zip(chosen, tree.query_ball_point(chosen[:, :2], 1.2)):
        drop = camera[2] - patches[near, 2]
        drop = drop[(drop > _LOWEST) & (drop < _HIGHEST)]
        if len(drop):
            votes += np.bincount((drop / _LEVEL).astype(int), minlength=bins)[:bins] / np.sqrt(len(drop))
    level = (np.arange(bins) + 0.5) * _LEVEL
    smooth = np.convolve(votes, np.exp(-0.5 * (np.arange(-6, 7) / 2.0) ** 2), mode="same")
    if camera_height is not None:
        smooth = np.where(np.abs(level - camera_height) <= 0.2 * camera_height + 0.05, smooth, 0.0)
    if smooth.max() <= 0:
        return None
    peaks = np.flatnonzero((smooth >= np.roll(smooth, 1)) & (smooth >= np.roll(smooth, -1)) & (smooth > 0))
    strong = peaks[smooth[peaks] >= 0.4 * smooth.max()]
    lowest = level[strong.max()]
    if camera_height is None and not above_another:
        drop = walk[cKDTree(walk[:, :2]).query(patches[:, :2])[1], 2] - patches[:, 2]
        under = float(np.mean(drop > lowest + _UNDER))
        floor = _clear_level(drop, cells, np.bincount(member))
        if floor is not None and (under >= _FEW or floor > lowest + _DEEPER):
            return floor
        if under >= (_SEVERAL if lowest < _NEAR else _MANY):
            deepest = float(np.percentile(drop, 99))
            raise InputError(
                f"Furniture may hide the floor: the clearest level is {lowest:.2f} m below the cameras, but "
                f"{under:.0%} of the points are more than {_UNDER} m under it, down to {deepest:.2f} m below. "
                "Give the height of the camera above the floor in meters (--camera-height)."
            )
    if above_another:
        over = lowest - level[strong]
        lowest = min((lowest, *level[strong][(over > _SLAB[0]) & (over < _SLAB[1])]))
    return float(lowest)


def _clear_level(drop: Float64, cells: NDArray[np.int64], points: NDArray[np.int64]) -> float | None:
    """The floor among patches that are `drop` (N,) meters below the cameras, are in `cells` (N, 3), and contain
    `points` (N,): the level with most ground that has little under it and clearly less just above it. None if no level
    is clear.

    Each ground cell has one vote, divided among its levels by their points. Fronts of cabinets and stray points of
    estimated depth fill many patches, but divide their vote among many levels. A floor concentrates it in one."""
    column = distinct_cells(cells[:, :2])[1]
    vote = points / np.bincount(column, points)[column]
    vote /= vote.sum()
    below = drop > 0
    counts = np.bincount((drop[below] / _LEVEL).astype(np.int64), vote[below], minlength=1)
    area = np.convolve(np.pad(counts, 8), np.ones(5), mode="same")
    above = np.convolve(area, np.ones(7) / 7, mode="full")[: len(area)]  # of the 7 levels up to each
    levels = np.arange(8, len(area) - 8)
    depth = (levels - 7.5) * _LEVEL
    clear = (area[levels] >= _AREA) & (area[levels] > _CLEAR * above[levels - 6])
    clear &= np.array([np.mean(drop > at + _UNDER) < _FEW for at in depth], bool)
    return float(depth[clear][area[levels][clear].argmax()]) if clear.any() else None


def stair_floor(positions: NDArray[np.floating], carried: float) -> FloorSurface:
    """The slope through the treads of a staircase climbed by cameras at `positions` (N, 3), meters, z up, which were
    `carried` meters above it. The cloud is not used, because every tread is a level of its own."""
    walk = np.asarray(positions, np.float64).reshape(-1, 3)
    grid = _Grid.around(walk, _TREAD)
    return grid.fit(walk - np.array([0.0, 0.0, carried]), np.ones(len(walk)), _SUPPLE)


def _patches(points: Float64, surface: FloorSurface, window: float, below: float) -> Float64:
    """(M, 3) one floor point per patch: the median of its points near the dominant height. The search goes from `below`
    meters under the expected floor to `window` meters above it. Surrounding patches contribute to the dominant
    height."""
    above = points[:, 2] - surface.height_at(points[:, :2])
    keep = (above >= -below) & (above <= window)
    points, above = points[keep], above[keep]
    if len(points) == 0:
        return np.empty((0, 3))
    cell = np.floor(points[:, :2] / _PATCH).astype(np.int64)
    cell -= cell.min(axis=0)
    columns, rows = (
        side + 1 for side in grid_size(np.zeros(2), cell.max(axis=0) * _PATCH, _PATCH, "the points of the floor")
    )
    bins = int(np.ceil(2 * window / _LEVEL)) + 1
    votes = np.zeros((rows, columns, bins), np.float32)
    index = ((above + window) / _LEVEL).astype(np.int64).clip(0, bins - 1)
    np.add.at(votes, (cell[:, 1], cell[:, 0], index), 1.0)
    from scipy.ndimage import gaussian_filter

    # A patch uses its neighborhood of about 1 m. Counts are damped so that a dense shelf does not dominate.
    shared = gaussian_filter(np.sqrt(votes), (1.5, 1.5, 1.2), mode="constant")
    level = (shared.argmax(axis=2) + 0.5) * _LEVEL - window
    near = np.abs(above - level[cell[:, 1], cell[:, 0]]) <= 2 * _LEVEL
    if window >= _WIDE:  # a front of furniture is at all heights, a floor at one
        clear = shared.max(axis=2) > _PEAKED * shared.mean(axis=2)
        near &= clear[cell[:, 1], cell[:, 0]]
    if not near.any():
        return np.empty((0, 3))
    points, above = points[near], above[near]
    flat = cell[near, 1] * columns + cell[near, 0]
    order = np.lexsort((above, flat))
    flat, points = flat[order], points[order]
    start = np.flatnonzero(np.append(True, flat[1:] != flat[:-1]))
    length = np.diff(np.append(start, len(flat)))
    middle: Float64 = points[start + length // 2]
    return middle


@dataclass(frozen=True)
class _Grid:
    rows: int
    columns: int
    origin: tuple[float, float]
    spacing: float

    @staticmethod
    def around(walk: Float64, spacing: float) -> _Grid:
        low = np.floor((walk[:, :2].min(axis=0) - _MARGIN) / spacing) * spacing
        high = walk[:, :2].max(axis=0) + _MARGIN
        cells = grid_size(low, high, spacing, "the cameras", _MOST_HEIGHTS)
        columns, rows = cells[0] + 1, cells[1] + 1
        return _Grid(rows, columns, (float(low[0]), float(low[1])), spacing)

    def fit(self, xyz: Float64, weight: Float64, stiffness: float) -> FloorSurface:
        """The smooth surface through points (M, 3) with weights (M,). It minimizes the squared height residuals, the
        curvature, and a small slope term. Far from any point, only the slope term has an effect."""
        from scipy.sparse import coo_array, diags_array, eye_array, kron, vstack
        from scipy.sparse.linalg import spsolve

        c = np.clip((xyz[:, 0] - self.origin[0]) / self.spacing, 0, self.columns - 1)
        r = np.clip((xyz[:, 1] - self.origin[1]) / self.spacing, 0, self.rows - 1)
        c0 = np.minimum(c.astype(np.int64), max(self.columns - 2, 0))
        r0 = np.minimum(r.astype(np.int64), max(self.rows - 2, 0))
        fc, fr = c - c0, r - r0
        size = self.rows * self.columns
        at = np.stack([r0 * self.columns + c0, r0 * self.columns + c0 + 1], axis=1)
        nodes = np.concatenate([at, at + self.columns], axis=1)
        share = np.stack([(1 - fc) * (1 - fr), fc * (1 - fr), (1 - fc) * fr, fc * fr], axis=1)
        row = np.repeat(np.arange(len(xyz)), 4)
        a = coo_array((share.reshape(-1), (row, nodes.reshape(-1))), shape=(len(xyz), size)).tocsr()

        def difference(n: int, order: int) -> Any:
            d = eye_array(n, format="csr")
            for _ in range(order):
                d = d[1:] - d[:-1]
            return d

        def differences_along_both_axes(order: int) -> Any:
            along = kron(eye_array(self.rows), difference(self.columns, order))
            across = kron(difference(self.rows, order), eye_array(self.columns))
            return vstack([along, across]).tocsr()

        bend, slope = differences_along_both_axes(2), differences_along_both_axes(1)
        mean = float(np.average(xyz[:, 2], weights=weight))
        w = diags_array(weight)
        normal = a.T @ w @ a + stiffness * (bend.T @ bend) + 0.002 * stiffness * (slope.T @ slope)
        normal = normal + 1e-9 * eye_array(size)
        heights = spsolve(normal.tocsc(), a.T @ (weight * (xyz[:, 2] - mean))) + mean
        return FloorSurface(heights.reshape(self.rows, self.columns).astype(np.float32), self.origin, self.spacing)
