"""Axes of a building from images: the vertical, the camera height, and the wall directions.

Images alone leave the scale of each part of a video open if few points connect one part to the next. A person carries
the camera at a constant height, so the floor gives the scale of every part that shows it. Vertical edges give the
vertical. Most walls are parallel or at right angles, so their lines give the direction of every part (Coughlan and
Yuille 1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
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
_UPRIGHT_LINE = 0.2  # |sine| of the angle between a possibly vertical line's plane and the vertical, at most
_TILTS, _TILT = 8.0, 0.5  # degrees: largest tilt of a given vertical, and distance of the tilts that are tried
_UP_ERROR = 4.0  # degrees: usual error of a given vertical
_LINE_ERROR = 0.3  # degrees: usual error of a line
_LINES = 4  # possibly vertical lines, at least
_INFORMATION = 0.3  # information on the vertical in both directions, at least: lines of full width at right angles
_DEVIATION, _LEAST_DEVIATION = 0.15, 0.05  # degrees: deviation of the vertical for an information of 1, and the least
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


@dataclass(frozen=True, eq=False)
class Lines:
    """Straight lines of images.

    normals  (N, 3) float64, unit vectors, world, at right angles to the plane of the line and the camera
    weights  (N,) float64, lengths over the image width
    """

    normals: NDArray[np.float64]
    weights: NDArray[np.float64]


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
    lines = None if image is None else cv2.createLineSegmentDetector().detect(image)[0]
    if image is None or lines is None:
        return np.zeros((0, 2, 2))
    ends = lines.reshape(-1, 2, 2).astype(np.float64)
    return ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > _SHORTEST * image.shape[1]]


def vertical_from_lines(lines: Lines, up: NDArray[np.float64]) -> tuple[NDArray[np.float64], float] | None:
    """The vertical (3,) from the vertical edges among `lines`, near a given vertical `up`, and its standard deviation
    in radians. None if they do not determine it: a single edge, or edges in one direction, leave a tilt open."""
    east, north = level_axes(up)
    beside = np.stack([lines.normals @ east, lines.normals @ north], axis=1)
    ahead = -lines.normals @ up
    near = np.abs(ahead) < _UPRIGHT_LINE
    beside, ahead, weights = beside[near], ahead[near], lines.weights[near]
    if len(ahead) < _LINES:
        return None
    steps = np.radians(np.arange(-_TILTS, _TILTS + _TILT / 2, _TILT))
    tilts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    off = (beside @ tilts.T - ahead[:, None]) / np.radians(_TILT)
    votes = weights @ np.exp(-(off**2)) * np.exp(-((tilts / np.radians(_UP_ERROR)) ** 2).sum(axis=1) / 2)
    tilt, information = tilts[votes.argmax()], np.zeros((2, 2))
    for _ in range(10):
        off = (beside @ tilt - ahead) / np.radians(_LINE_ERROR)
        weighted = beside * (weights / (1 + off**2) ** 2)[:, None]
        information = weighted.T @ beside + 1e-6 * np.eye(2)
        tilt = np.linalg.solve(information, weighted.T @ ahead)
    least = float(np.linalg.eigvalsh(information)[0])
    if least < _INFORMATION or np.abs(tilt).max() > np.radians(_TILTS):
        return None
    found = up + tilt @ np.stack([east, north])
    return found / np.linalg.norm(found), float(np.radians(max(_DEVIATION / least**0.5, _LEAST_DEVIATION)))


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
