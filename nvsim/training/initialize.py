"""The initial Gaussians of a training: cloud points that the views see, and estimated points where the cloud has
none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.capture.types import Cloud
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.kernels import njit, prange
from nvsim.render.sky import pack_camera
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians
from nvsim.training.config import TrainingConfig
from nvsim.training.starting_points import detail_shares, flatten, guessed_points, triangulated_cloud
from nvsim.training.views import TrainingView

FARTHEST = 15.0
"""Meters beyond which a point does not count as seen."""
CELLS = 48
"""Columns of the coarse depth image that separates occluded points from visible ones."""
LEAST_SCALE, LARGEST_SCALE = 0.005, 0.3
"""Bounds of the initial standard deviations, meters."""
SPARSE_SHARE = 0.4
"""Greatest share of the seeds from a sparse cloud of features. It has no points on plain walls; estimates fill the
rest."""
FEW = 500
"""A LiDAR scan with fewer visible points is supplemented by estimates too."""
Float32 = NDArray[np.float32]
_F = np.float32


@njit(inline="always")
def _cell(
    camera: Float32,  # (16,) `pack_camera`
    size: Float32,  # (2,) width and height, pixels
    rows: int,  # of the coarse image
    columns: int,
    x: np.float32,  # meters, world, as the next two
    y: np.float32,
    z: np.float32,
) -> tuple[int, int, np.float32]:
    # Row, column, and depth of a world point in the coarse image; row -1 if the view does not show it.
    dx, dy, dz = x - camera[9], y - camera[10], z - camera[11]
    depth = camera[2] * dx + camera[5] * dy + camera[8] * dz
    if depth < _F(0.1) or depth > _F(FARTHEST):
        return -1, -1, depth
    u = camera[12] * (camera[0] * dx + camera[3] * dy + camera[6] * dz) / depth + camera[14]
    v = camera[13] * (camera[1] * dx + camera[4] * dy + camera[7] * dz) / depth + camera[15]
    if not (u >= 0 and v >= 0 and u < size[0] and v < size[1]):
        return -1, -1, depth
    return int(v * rows / size[1]), int(u * columns / size[0]), depth


@njit(parallel=True, cache=True)
def _nearest_depths(
    points: Float32,  # (N, 3) meters, world
    cameras: Float32,  # (V, 16) `pack_camera`
    sizes: Float32,  # (V, 2) width and height, pixels
    depths: Float32,  # (V, rows, columns) meters, changed
) -> None:
    _, rows, columns = depths.shape
    for view in prange(len(cameras)):
        for i in range(len(points)):
            r, c, d = _cell(cameras[view], sizes[view], rows, columns, points[i, 0], points[i, 1], points[i, 2])
            if r >= 0 and d < depths[view, r, c]:
                depths[view, r, c] = d


@njit(parallel=True, cache=True)
def _closest_sight(
    points: Float32,  # (N, 3) meters, world
    cameras: Float32,  # (V, 16) `pack_camera`
    sizes: Float32,  # (V, 2) width and height, pixels
    depths: Float32,  # (V, rows, columns) meters, of `_nearest_depths`
    best: NDArray[np.int64],  # (N,) out: the nearest view that sees the point, or -1
    distance: Float32,  # (N,) out: meters along the axis of that view
) -> None:
    # A point is visible if it is not far behind the nearest point of its cell.
    _, rows, columns = depths.shape
    for i in prange(len(points)):
        best[i], distance[i] = -1, _F(1e9)
        for view in range(len(cameras)):
            r, c, d = _cell(cameras[view], sizes[view], rows, columns, points[i, 0], points[i, 1], points[i, 2])
            if r >= 0 and d < distance[i] and d < depths[view, r, c] * _F(1.15) + _F(0.15):
                best[i], distance[i] = view, d


def initial_gaussians(
    views: Sequence[TrainingView],
    cloud: Cloud | None,
    floor: FloorSurface,
    config: TrainingConfig,
    rng: np.random.Generator,
) -> Gaussians:
    """At most `seed_share` of the cap. Every Gaussian has the configured opacity, is round, and is as wide as the
    distance to its neighbors. Gaussians of a LiDAR scan are flattened along the surface normal. Estimated points from
    the images supplement a missing or sparse cloud."""
    count = max(int(config.gaussian_cap * config.seed_share), 1)
    cloud = triangulated_cloud(views) if cloud is None else cloud
    points, colors = visible_points(views, cloud)
    points, colors = _points_above_floor(points, colors, floor, config)
    surface = points
    most = count if cloud.is_dense else int(count * SPARSE_SHARE)
    if len(points) > most:
        shares = detail_shares(points, colors, config.seed_detail) if config.seed_detail > 0 else None
        chosen = np.sort(rng.choice(len(points), most, replace=False, p=shares))
        points, colors = points[chosen], colors[chosen]
    if not cloud.is_dense or len(points) < FEW:
        more, more_colors = guessed_points(views, points, floor, count - len(points), rng)
        more, more_colors = _points_above_floor(more, more_colors, floor, config)
        points, colors = np.concatenate([points, more]), np.concatenate([colors, more_colors])
    made = gaussians_at(points, colors, config.sh_degree, config.seed_opacity)
    made.log_scales += np.float32(np.log(config.seed_size))
    if cloud.is_dense and config.seed_flatness < 1:
        flatten(made, surface, config.seed_flatness)
    return made


def gaussians_at(points: Float32, colors: Float32, sh_degree: int, opacity: float = 0.5) -> Gaussians:
    """Gaussians at `points` (N, 3), meters, with `colors` (N, 3), 0 to 1."""
    n = len(points)
    neighbors = min(4, n)
    spacing = np.full(n, LARGEST_SCALE)
    if neighbors > 1:
        spacing = cKDTree(points).query(points, k=neighbors)[0][:, 1:].mean(axis=1)
    log_scales = np.log(np.clip(spacing, LEAST_SCALE, LARGEST_SCALE)).astype(np.float32)
    sh = np.zeros((n, (sh_degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = (colors - 0.5) / DC
    quats = np.zeros((n, 4), np.float32)
    quats[:, 0] = 1
    means = np.ascontiguousarray(points, np.float32)
    logits = np.full(n, np.log(opacity / (1 - opacity)), np.float32)
    return Gaussians(means, np.repeat(log_scales[:, None], 3, axis=1), quats, logits, sh)


def visible_points(views: Sequence[TrainingView], cloud: Cloud) -> tuple[Float32, Float32]:
    """The points (N, 3), meters, that some view sees; a coarse depth image of the cloud itself removes occluded ones.
    Their colors (N, 3), 0 to 1, are the cloud's, or those of the pixel in the nearest view that sees the point."""
    finite = np.isfinite(cloud.points).all(axis=1)
    points = np.ascontiguousarray(cloud.points[finite], np.float32)
    cameras = np.stack([pack_camera(v.camera) for v in views])
    sizes = np.array([(v.camera.intrinsics.width, v.camera.intrinsics.height) for v in views], np.float32)
    depths = np.full((len(views), max(round(CELLS * sizes[0, 1] / sizes[0, 0]), 1), CELLS), np.inf, np.float32)
    best, distance = np.empty(len(points), np.int64), np.empty(len(points), np.float32)
    _nearest_depths(points, cameras, sizes, depths)
    _closest_sight(points, cameras, sizes, depths, best, distance)
    seen = best >= 0
    if cloud.colors is not None:
        return points[seen], cloud.colors[finite][seen].astype(np.float32) / np.float32(255)
    return points[seen], _pixel_colors(views, points[seen], best[seen])


def _pixel_colors(views: Sequence[TrainingView], points: Float32, best: NDArray[np.int64]) -> Float32:
    colors = np.empty((len(points), 3), np.float32)
    for i, view in enumerate(views):
        mine = best == i
        pixels, _ = view.camera.project(points[mine])
        u = np.clip(pixels[:, 0].astype(int), 0, view.image.shape[1] - 1)
        v = np.clip(pixels[:, 1].astype(int), 0, view.image.shape[0] - 1)
        colors[mine] = view.image[v, u].astype(np.float32) / 255
    return colors


def _points_above_floor(
    points: Float32, colors: Float32, floor: FloorSurface, config: TrainingConfig
) -> tuple[Float32, Float32]:
    if config.seed_height <= 0:
        return points, colors
    above = points[:, 2] > floor.height_at(points[:, :2]) + config.seed_height
    return points[above], colors[above]
