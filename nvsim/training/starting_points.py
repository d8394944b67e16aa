"""The points from which a training starts: from a LiDAR scan, from images, and at guessed depths.

A plain wall has one color over meters, a bookshelf a new one every few centimeters. Seeds by the local deviation of
the colors start close to the distribution that growth would produce. A flat Gaussian covers the surface without
thickness.

Known depths in a view are those of its cloud points, and those at the upper edge of its floor, at the foot of walls
and furniture. The inverse depth is interpolated between them, because it is linear on a plane. Without known depths
the depth is random.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from nvsim.capture.triangulation import Features, triangulate
from nvsim.capture.types import Cloud
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.nearest_points import axes_of
from nvsim.splats.types import Gaussians
from nvsim.training.views import TrainingView

AROUND = 8
"""Number of scan points in a neighborhood, its center included."""
PLAIN = 0.03
"""Color deviation, 0 to 1, that is assumed for a plain surface."""
Float32 = NDArray[np.float32]


def _nearest(points: Float32, places: Float32) -> NDArray[np.int64]:
    # Neither option changes the result; such a tree is built in a third of the time.
    tree = cKDTree(points, compact_nodes=False, balanced_tree=False)
    return np.asarray(tree.query(places, k=min(AROUND, len(points)), workers=-1)[1])


def detail_shares(points: Float32, colors: Float32, exponent: float) -> NDArray[np.float64]:
    """(N,) the probability of each of `points` (N, 3) to become a seed: the deviation of the `colors` (N, 3) around it
    to the power of `exponent`."""
    nearest = _nearest(points, points).reshape(len(points), -1)
    deviation = colors[nearest].std(axis=1).mean(axis=1).astype(np.float64)
    weight = (PLAIN + deviation) ** exponent
    return np.asarray(weight / weight.sum())


def flatten(gaussians: Gaussians, surface: Float32, flatness: float) -> None:
    """Turns round Gaussians so that their first axis is the normal of the points `surface` (M, 3), meters, around them,
    and shortens that axis by the factor `flatness`. Does nothing if there are too few points for a normal."""
    if len(surface) < AROUND or len(gaussians) == 0:
        return
    nearest = _nearest(surface, gaussians.means)
    axes = axes_of(surface[nearest])
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]  # a rotation, no reflection
    gaussians.quats[:] = Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]]
    gaussians.log_scales[:, 0] += np.float32(np.log(flatness))


NEAR, FAR = 0.5, 6.0
"""Least and greatest depth of pixels without known depths nearby, meters."""
NEIGHBORS = 6
"""Number of known pixels from which a depth is interpolated."""
SPREAD = 0.05
"""Relative standard deviation of the random error added to the depths, because they are estimates."""


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
        inverse = _inverse_depths(pixels, _known_depths(view, points, floor), rng)
        rays = view.camera.rays().reshape(-1, 3)[chosen]
        along = rays @ view.camera.rotation[:, 2]
        found.append((view.camera.position + rays / (inverse * along)[:, None]).astype(np.float32))
        colors.append(view.image.reshape(-1, 3)[chosen].astype(np.float32) / 255)
    return np.concatenate(found), np.concatenate(colors)


def _known_depths(view: TrainingView, points: Float32, floor: FloorSurface) -> NDArray[np.float64]:
    """(K, 3): x, y in pixels and inverse depth in 1/m of the known depths in a view."""
    k = view.camera.intrinsics
    pixels, depth = view.camera.project(points)
    inside = (depth > 0.2) & (pixels >= 0).all(axis=1) & (pixels[:, 0] < k.width) & (pixels[:, 1] < k.height)
    cloud = np.column_stack([pixels[inside], 1 / depth[inside]])
    columns = np.flatnonzero(view.floor.any(axis=0))
    rows = view.floor[:, columns].argmax(axis=0)
    rays = view.camera.rays()[rows, columns]
    distance = floor.distance_along_rays(view.camera.position, rays) * (rays @ view.camera.rotation[:, 2])
    met = np.isfinite(distance) & (distance > 0.2)
    edge = np.column_stack([columns[met] + 0.5, rows[met] + 0.5, 1 / distance[met]])
    return np.concatenate([cloud, edge])


def _inverse_depths(
    pixels: NDArray[np.float64], known: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    if len(known) < NEIGHBORS:
        return (FAR / NEAR) ** rng.random(len(pixels)) / FAR
    distance, nearest = cKDTree(known[:, :2]).query(pixels, k=NEIGHBORS)
    weight = 1 / (distance + 2.0)
    guess = np.sum(weight * known[nearest, 2], axis=1) / weight.sum(axis=1)
    return np.clip(guess * np.exp(SPREAD * rng.standard_normal(len(pixels))), 0.05, 5.0)


PARTNERS = 3
"""Number of later views with which each view is matched; they look in a similar direction from another place."""
BASELINE = (0.08, 3.0)
"""Least and greatest meters between two matched views."""
LARGEST_TURN = np.radians(35)
NEAREST, FARTHEST = 0.2, 20.0
"""Least and greatest depth along the optical axis, meters."""


def triangulated_cloud(views: Sequence[TrainingView]) -> Cloud:
    """A point cloud of kind "sfm", empty if no features match."""
    features = [Features.of(view.camera, view.image, view.usable) for view in views]
    points, colors = [np.zeros((0, 3), np.float32)], [np.zeros((0, 3), np.uint8)]
    for i, j in _pairs(views):
        found, pixels = triangulate(features[i], features[j])
        near = np.ones(len(found), bool)
        for view in (views[i], views[j]):
            _, depth = view.camera.project(found)
            near &= (depth > NEAREST) & (depth < FARTHEST)
        columns, rows = pixels[near].astype(np.int64).T
        points.append(found[near].astype(np.float32))
        colors.append(views[i].image[rows, columns])
    return Cloud(np.concatenate(points), np.concatenate(colors), "sfm")


def _pairs(views: Sequence[TrainingView]) -> list[tuple[int, int]]:
    positions = np.array([v.camera.position for v in views])
    axes = np.array([v.camera.rotation[:, 2] for v in views])
    pairs = []
    for i in range(len(views)):
        distance = np.linalg.norm(positions[i + 1 :] - positions[i], axis=1)
        turned = np.arccos(np.clip(axes[i + 1 :] @ axes[i], -1, 1))
        fits = (distance > BASELINE[0]) & (distance < BASELINE[1]) & (turned < LARGEST_TURN)
        candidates = np.flatnonzero(fits)
        nearest = candidates[np.argsort(distance[candidates], kind="stable")[:PARTNERS]]
        pairs += [(i, i + 1 + int(j)) for j in nearest]
    return pairs
