"""Axes of a building from images: the vertical, the camera height, and the wall directions.

Images alone leave the scale of each part of a video open if few points connect one part to the next. A person carries
the camera at a constant height, so the floor gives the scale of every part that shows it. Vertical edges give the
vertical. Most walls are parallel or at right angles, so their lines give the direction of every part (Coughlan and
Yuille 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pycolmap
from numpy.typing import NDArray

from nvsim.capture.alignment import HELD_UPRIGHT, are_sideways
from nvsim.capture.vertical_edges import Lines, long_segments
from nvsim.geometry.camera import quarter_turns
from nvsim.geometry.rotation import level_axes
from nvsim.poses.piece_reliability import Observations

_STEEP = 4.0  # largest distance of a floor point, in units of its drop below the camera
_SAME = 0.03  # difference of the logarithms of two heights of the same floor
_FLOOR = 30  # points of a floor, at least
_DENSER = 3.0  # density of the floor level over the density just above it
_DEEPER = 0.35  # largest number of points below the floor, over the points of the floor
_SIDEWAYS = 0.05  # second singular value of the sideways axes over the largest, at least, to estimate the vertical
_LEVEL, _UPRIGHT = 0.97, 0.15  # |sine| above and below which a line does not give the direction of its wall
_BINS = 180  # histogram bins of wall directions in a quarter turn
_CLEAR = 8.0  # height of the wall peak over the mean of the histogram, at least; 12 to 48 in buildings


def vertical_of(rotations: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The vertical (3,) as unit vector in the world, from rotations (I, 3, 3), world to camera. People hold a camera
    level, so its sideways axis is horizontal; images of a phone held upright may be stored sideways. None if all images
    look in one direction."""
    if are_sideways(rotations[:, 0], rotations[:, 1]):
        rotations = quarter_turns(HELD_UPRIGHT) @ rotations
    _, size, axes = np.linalg.svd(rotations[:, 0])
    if size[1] < _SIDEWAYS * size[0]:
        return None
    up = axes[2]
    return np.asarray(-up if up @ rotations[:, 1].sum(axis=0) > 0 else up)


def camera_height(
    seen: Observations, images: NDArray[np.bool_], up: NDArray[np.float64], is_exact: bool = False
) -> tuple[float, NDArray[np.float64]] | None:
    """Height of the cameras of `images` (I,) above the floor, in the unit of `seen`, and the vertical `up` (3,).

    The vertical is refined by the floor unless it `is_exact`. None if no floor is clear. The floor is the lowest level
    that contains many points. A mirror image below the floor contains fewer."""
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
        if is_exact:
            height = left[inside].mean()
        else:
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


def lines_of(folder: Path, views: Sequence[tuple[str, pycolmap.Camera, NDArray[np.float64]]]) -> Lines:
    """The straight lines in `views`. Each view is an image name in `folder`, its camera, and its rotation (3, 3), world
    to camera."""
    normals, weights = [np.zeros((0, 3))], [np.zeros(0)]
    for name, camera, rotation in views:
        path = folder / name
        ends = _segments(path, path.stat().st_mtime_ns) if path.is_file() else np.zeros((0, 2, 2))
        if len(ends):
            flat = np.asarray(camera.cam_from_img(ends.reshape(-1, 2) + 0.5)).reshape(-1, 2)
            rays = np.column_stack([flat, np.ones(len(flat))]).reshape(-1, 2, 3)
            normal = np.cross(rays[:, 0], rays[:, 1]) @ rotation
            normals.append(normal / np.linalg.norm(normal, axis=1, keepdims=True))
            weights.append(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / camera.width)
    return Lines(np.concatenate(normals), np.concatenate(weights))


@lru_cache(maxsize=2048)
def _segments(path: Path, changed: int) -> NDArray[np.float64]:
    """The ends (N, 2, 2) in pixels of the long lines of an image that was `changed` at this time. Empty if it cannot be
    read."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    return np.zeros((0, 2, 2)) if image is None else long_segments(np.asarray(image, np.uint8))


def wall_direction(lines: Lines, up: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The horizontal direction (3,) of the walls, or one at right angles to it, from straight `lines`. None if no
    direction is clear."""
    east, north = level_axes(up)
    tilt = np.abs(lines.normals @ up)
    # A horizontal line is in the plane of its normal. If that plane is horizontal, its direction is open.
    use = (tilt > _UPRIGHT) & (tilt < _LEVEL)
    if not use.any():
        return None
    angle = np.arctan2(-(lines.normals[use] @ east), lines.normals[use] @ north) % (np.pi / 2)
    weight = lines.weights[use] * np.sqrt(1 - tilt[use] ** 2)
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


def _weighted_median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])
