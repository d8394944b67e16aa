"""Axes of a building from images: the vertical, the camera height, and the wall directions.

Images alone leave the scale of each part of a video open if few points connect one part to the next. A person carries
the camera at a constant height, so the floor gives the scale of every part that shows it. Most walls are parallel or at
right angles, so their lines give the direction of every part (Coughlan and Yuille 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.poses.piece_reliability import Observations

_STEEP = 4.0  # largest distance of a floor point, in units of its drop below the camera
_SAME = 0.03  # difference of the logarithms of two heights of the same floor
_FLOOR = 30  # points of a floor, at least
_DENSER = 3.0  # density of the floor level over the density just above it
_DEEPER = 0.35  # largest number of points below the floor, over the points of the floor
_SIDEWAYS = 0.05  # second singular value of the sideways axes over the largest, at least, to estimate the vertical
_SHORTEST = 0.06  # shortest line that is used, over the image width
_LEVEL, _UPRIGHT = 0.97, 0.15  # |sine| above and below which a line does not give the direction of its wall
_LOOKED_AT = 40  # images of a piece in which lines are detected
_BINS = 180  # histogram bins of wall directions in a quarter turn
_CLEAR = 8.0  # height of the wall peak over the mean of the histogram, at least; 12 to 48 in buildings


def vertical_of(rotations: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The vertical (3,) as unit vector in the world, from rotations (I, 3, 3), world to camera. People hold a camera
    level, so its sideways axis is horizontal. None if all images look in one direction."""
    _, size, axes = np.linalg.svd(rotations[:, 0])
    if size[1] < _SIDEWAYS * size[0]:
        return None
    up = axes[2]
    return np.asarray(-up if up @ rotations[:, 1].sum(axis=0) > 0 else up)


def camera_height(
    seen: Observations, images: NDArray[np.bool_], up: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]] | None:
    """Height of the cameras of `images` (I,) above the floor, in the unit of `seen`, and the refined `up` (3,).

    None if no floor is clear. The floor is the lowest level that contains many points. A mirror image below the floor
    contains fewer."""
    rows = images[seen.image]
    below = seen.center[seen.image[rows]] - seen.places[seen.point[rows]]
    drop = below @ up
    near = (drop > 0) & (np.linalg.norm(below, axis=1) < _STEEP * drop)
    point, index = np.unique(seen.point[rows][near], return_inverse=True)
    if len(point) < _FLOOR:
        return None
    depth = np.log(np.bincount(index, drop[near]) / np.bincount(index))
    level = _floor_level(np.sort(depth))
    if level is None:
        return None
    # A tilted up makes far points of the floor seem higher or lower than near ones.
    east, north = level_axes(up)
    below = below[near]
    beside = np.stack([below @ east, below @ north, np.ones(len(below))], axis=1)
    height, tilt = np.exp(level), np.zeros(2)
    for width in (3 * _SAME, 2 * _SAME, _SAME, _SAME):
        left = drop[near] - beside[:, :2] @ tilt
        inside = np.abs(left / height - 1) < width
        if inside.sum() < _FLOOR:
            return None
        *tilt, height = np.linalg.lstsq(beside[inside], drop[near][inside], rcond=None)[0]
    own_up = up - tilt[0] * east - tilt[1] * north
    size = float(np.linalg.norm(own_up))
    return float(height) / size, own_up / size


def _floor_level(depth: NDArray[np.float64]) -> float | None:
    """The level of the floor, from the sorted logarithms of depths below the camera."""
    inside = np.searchsorted(depth, depth + _SAME) - np.searchsorted(depth, depth - _SAME)
    above = np.searchsorted(depth, depth - 2 * _SAME) - np.searchsorted(depth, depth - 8 * _SAME)
    deeper = np.searchsorted(depth, depth + 0.5) - np.searchsorted(depth, depth + 3 * _SAME)
    fit = (inside >= _FLOOR) & (inside > _DENSER * above / 3) & (deeper < _DEEPER * inside)
    return float(depth[np.argmax(np.where(fit, inside, 0))]) if fit.any() else None


def wall_direction(
    folder: Path, views: Sequence[tuple[str, pycolmap.Camera, NDArray[np.float64]]], up: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """The horizontal direction (3,) of the walls, or one at right angles to it, from the straight lines in `views`.

    Each view is an image name in `folder`, its camera, and its rotation (3, 3), world to camera. None if no direction
    is clear."""
    east, north = level_axes(up)
    angles, weights = [], []
    for name, camera, rotation in views[:: max(1, len(views) // _LOOKED_AT)]:
        path = folder / name
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) if path.is_file() else None
        if image is None:
            continue
        lines = cv2.createLineSegmentDetector().detect(image)[0]
        if lines is None:
            continue
        ends = lines.reshape(-1, 2, 2).astype(np.float64)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        ends, length = ends[length > _SHORTEST * image.shape[1]], length[length > _SHORTEST * image.shape[1]]
        if not len(ends):
            continue
        flat = np.asarray(camera.cam_from_img(ends.reshape(-1, 2) + 0.5)).reshape(-1, 2)
        rays = np.column_stack([flat, np.ones(len(flat))]).reshape(-1, 2, 3)
        normal = np.cross(rays[:, 0], rays[:, 1]) @ rotation
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        tilt = np.abs(normal @ up)
        # A horizontal line is in the plane of its normal. If that plane is horizontal, its direction is open.
        use = (tilt > _UPRIGHT) & (tilt < _LEVEL)
        angles.append(np.arctan2(-(normal[use] @ east), normal[use] @ north))
        weights.append(length[use] / image.shape[1] * np.sqrt(1 - tilt[use] ** 2))
    if not angles or not sum(len(a) for a in angles):
        return None
    angle, weight = np.concatenate(angles) % (np.pi / 2), np.concatenate(weights)
    counts = np.bincount((angle / (np.pi / 2) * _BINS).astype(int) % _BINS, weight, _BINS)
    smooth = np.sum([np.roll(counts, k) * (3 - abs(k)) for k in range(-2, 3)], axis=0) / 9
    best = int(smooth.argmax())
    if smooth[best] < _CLEAR * smooth.mean():
        return None
    center = (best + 0.5) / _BINS * np.pi / 2
    for width in (3.0, 2.0, 1.5):
        off = (angle - center + np.pi / 4) % (np.pi / 2) - np.pi / 4
        inside = np.abs(off) < np.radians(width)
        center += _weighted_median(off[inside], weight[inside])
    return np.asarray(np.cos(center) * east + np.sin(center) * north)


def level_axes(up: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two horizontal unit vectors (3,) at right angles to `up` and to each other. The second is the first, rotated by a
    quarter turn about `up`."""
    east = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    east /= np.linalg.norm(east)
    return east, np.cross(up, east)


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])
