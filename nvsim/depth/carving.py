"""Points that are not there: depth maps see through them rather than show them.

A map counts by the pixels that it has for a patch of the size of the point's cell, the inverse square of the distance:
the thin top of a table is a line of pixels for cameras across the room, who see the wall behind it and are many.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera

Float32 = NDArray[np.float32]

_TIMES = 2  # a point stays that is shown by so many times the pixels that see through it
_PIXELS = 4096.0  # that a map counts for a metre before its camera, so that sums of whole numbers are exact
_NEAREST = 2.5  # metres: one nearer counts no more, or a single camera beside a wall could take it away
_SHOWN = 0.05  # share of its inverse depth within which a map shows a point
_THROUGH = 0.1  # share of it by which a map that sees through a point lies behind


@njit(cache=True, nogil=True, error_model="numpy")
def _judge(
    points: Float32,
    lens: NDArray[np.float64],
    pose: NDArray[np.float64],
    inverse: Float32,
    shown: NDArray[np.int64],
    through: NDArray[np.int64],
) -> None:
    """Counts for points (N, 3) the pixels with which the map `inverse` (H, W), 0 where unknown, shows them or sees
    through them. `lens` is fx, fy, cx, cy, `pose` (3, 4) world to camera."""
    height, width = inverse.shape
    fx, fy, cx, cy = lens
    for i in range(len(points)):
        x, y, z = points[i]
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        if depth <= 0.05:
            continue
        u = fx * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / depth + cx
        v = fy * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / depth + cy
        if not (u >= 0 and v >= 0 and u < width and v < height):
            continue
        there = inverse[int(v), int(u)]
        if there <= 0:
            continue
        pixels = int(_PIXELS / max(depth, _NEAREST) ** 2)
        if there * depth < 1 - _THROUGH:
            through[i] += pixels
        elif abs(there * depth - 1) < _SHOWN:
            shown[i] += pixels


def judge(
    points: Float32, camera: Camera, inverse: Float32, shown: NDArray[np.int64], through: NDArray[np.int64]
) -> None:
    """Adds to `shown` and `through` (N,) for how many pixels a map (H, W) of inverse depth, 0 where unknown, that
    `camera` made counts that shows the points (N, 3), or sees through them."""
    k, pose = camera.intrinsics, np.ascontiguousarray(camera.world_to_camera[:3], np.float64)
    _judge(points, np.array([k.fx, k.fy, k.cx, k.cy]), pose, inverse, shown, through)


def standing(points: Float32, cameras: list[Camera], maps: Callable[[int], Float32], threads: int) -> NDArray[np.bool_]:
    """Whether each of the points (N, 3) is there, by the `maps` of inverse depth, (H, W) float32 of the sizes of the
    `cameras`, 0 where unknown."""

    def count(first: int) -> NDArray[np.int64]:
        counts = np.zeros((2, len(points)), np.int64)
        for i in range(first, len(cameras), threads):
            judge(points, cameras[i], maps(i), counts[0], counts[1])
        return counts

    with ThreadPoolExecutor(threads) as pool:
        counts = np.stack(list(pool.map(count, range(threads)))).sum(axis=0)
    return np.asarray(counts[0] >= _TIMES * counts[1])
