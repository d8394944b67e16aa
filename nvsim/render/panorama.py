"""Cameras that look around from one place, and the panorama that their views make."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look


def ring(
    position: NDArray[np.floating],
    count: int,
    elevation: float = 0.0,
    size: tuple[int, int] = (640, 480),
    hfov: float = math.radians(60),
    offset: float = 0.0,
) -> list[Camera]:
    """`count` level cameras at `position` (3,) at equal steps of heading, clockwise seen from above.

    The first looks along heading `offset` (radians, 0 is +y), all at `elevation` (radians, positive up); `size` is
    width and height in pixels, `hfov` the horizontal field of view in radians.
    """
    intrinsics = Intrinsics.from_fov(size[0], size[1], hfov)
    headings = offset + 2 * math.pi * np.arange(count) / count
    return [Camera(intrinsics, look(np.asarray(position, np.float64), h, elevation)) for h in headings]


def cube(position: NDArray[np.floating], side: int, offset: float = 0.0) -> list[Camera]:
    """Six views of 90 degrees and `side` x `side` pixels: up, the four headings from `offset` on clockwise, down. The
    faces of up and down have heading `offset` at their lower and upper edge."""
    up = ring(position, 1, math.pi / 2, (side, side), math.pi / 2, offset)
    level = ring(position, 4, 0.0, (side, side), math.pi / 2, offset)
    down = ring(position, 1, -math.pi / 2, (side, side), math.pi / 2, offset)
    return [*up, *level, *down]
