"""Points on surfaces without cloud points: random pixels, at a depth interpolated from their neighbors in the image.

Known depths in a view are those of its cloud points, and those at the upper edge of its floor, at the foot of walls and
furniture. The inverse depth is interpolated between them, because it is linear on a plane. Without known depths the
depth is random.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.training.views import TrainingView

NEAR, FAR = 0.5, 6.0
"""Least and greatest depth of pixels without known depths nearby, meters."""
NEIGHBOURS = 6
"""Number of known pixels from which a depth is interpolated."""
SPREAD = 0.05
"""Relative standard deviation of the random error added to the depths, because they are estimates."""
Float32 = NDArray[np.float32]


def guessed_points(
    views: Sequence[TrainingView], points: Float32, floor: FloorSurface, count: int, rng: np.random.Generator
) -> tuple[Float32, Float32]:
    """`count` points (N, 3), meters, world, on the rays of random pixels that are not floor, and the colors (N, 3) of
    the pixels, 0 to 1. `points` (M, 3) is the cloud and can be empty."""
    per_view = np.bincount(rng.integers(0, len(views), count), minlength=len(views))
    found, colors = [np.zeros((0, 3), np.float32)], [np.zeros((0, 3), np.float32)]
    for view, n in zip(views, per_view, strict=True):
        candidates = np.flatnonzero(~view.floor.reshape(-1))
        if n == 0 or len(candidates) == 0:
            continue
        chosen = rng.choice(candidates, n)
        width = view.image.shape[1]
        pixels = np.stack([chosen % width, chosen // width], axis=1) + 0.5
        inverse = _inverse_depths(pixels, _known(view, points, floor), rng)
        rays = view.camera.rays().reshape(-1, 3)[chosen]
        along = rays @ view.camera.rotation[:, 2]
        found.append((view.camera.position + rays / (inverse * along)[:, None]).astype(np.float32))
        colors.append(view.image.reshape(-1, 3)[chosen].astype(np.float32) / 255)
    return np.concatenate(found), np.concatenate(colors)


def _known(view: TrainingView, points: Float32, floor: FloorSurface) -> NDArray[np.float64]:
    """(K, 3): x, y in pixels and inverse depth in 1/m of the known depths in a view."""
    k = view.camera.intrinsics
    pixels, depth = view.camera.project(points)
    inside = (depth > 0.2) & (pixels >= 0).all(axis=1) & (pixels[:, 0] < k.width) & (pixels[:, 1] < k.height)
    cloud = np.column_stack([pixels[inside], 1 / depth[inside]])
    columns = np.flatnonzero(view.floor.any(axis=0))
    rows = view.floor[:, columns].argmax(axis=0)
    rays = view.camera.rays()[rows, columns]
    distance = floor.meet(view.camera.position, rays) * (rays @ view.camera.rotation[:, 2])
    met = np.isfinite(distance) & (distance > 0.2)
    edge = np.column_stack([columns[met] + 0.5, rows[met] + 0.5, 1 / distance[met]])
    return np.concatenate([cloud, edge])


def _inverse_depths(
    pixels: NDArray[np.float64], known: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    if len(known) < NEIGHBOURS:
        return (FAR / NEAR) ** rng.random(len(pixels)) / FAR
    distance, nearest = cKDTree(known[:, :2]).query(pixels, k=NEIGHBOURS)
    weight = 1 / (distance + 2.0)
    guess = np.sum(weight * known[nearest, 2], axis=1) / weight.sum(axis=1)
    return np.clip(guess * np.exp(SPREAD * rng.standard_normal(len(pixels))), 0.05, 5.0)
