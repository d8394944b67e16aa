"""Camera sets that look around from one place, and the arrangement of six of their images in a skybox strip."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look

_RIGHT = math.pi / 2


def ring(
    position: NDArray[np.floating],
    count: int,
    elevation: float = 0.0,
    size: tuple[int, int] = (640, 480),
    hfov: float = math.radians(60),
    offset: float = 0.0,
) -> list[Camera]:
    """`count` cameras at `position` (3,), meters, at equal steps of heading, clockwise seen from above.

    The first looks along heading `offset` (radians, 0 is +y), all at `elevation` (radians, positive up). `size` is the
    width and height in pixels, `hfov` the horizontal field of view in radians.
    """
    intrinsics = Intrinsics.from_fov(size[0], size[1], hfov)
    headings = offset + 2 * math.pi * np.arange(count) / count
    return [Camera(intrinsics, look(np.asarray(position, np.float64), h, elevation)) for h in headings]


def cube(position: NDArray[np.floating], side: int, offset: float = 0.0) -> list[Camera]:
    """Six views from `position` (3,), meters, of 90 degrees and `side` x `side` pixels: up, four headings clockwise
    from `offset` (radians) on, down. Up has heading `offset` at its lower edge, down at its upper edge."""
    intrinsics = Intrinsics.from_fov(side, side, _RIGHT)
    at = np.asarray(position, np.float64)
    turns = [(offset, _RIGHT), *((offset + k * _RIGHT, 0.0) for k in range(4)), (offset, -_RIGHT)]
    return [Camera(intrinsics, look(at, heading, elevation)) for heading, elevation in turns]


def skybox(faces: list[NDArray[np.generic]]) -> NDArray[np.generic]:
    """Six square images (S, S, ...) in the order of `cube` as one strip (S, 6 S, ...): up, back, left, front, right,
    down. These are the order and orientation of Matterport's skyboxes for a viewpoint whose pose looks along the cube's
    heading. The lower edge of up and the upper edge of down touch the back."""
    up, front, right, back, left, down = faces
    return np.concatenate([np.rot90(up, 2), back, left, front, right, np.rot90(down, 2)], axis=1)
