"""Sample a strip as Matterport3DSimulator does: bilinearly on the nearest cube face, without blending across borders.

This module is written from the layout's table of faces and does not use `nvsim.geometry.skybox_faces`, so that each can
test the other.
Source: Matterport3DSimulator, MatterSim.cpp, with whose images the result was compared.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

UP, BACK, LEFT, FRONT, RIGHT, DOWN = range(6)


def place_on_strip(ways: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The face (...), and the position on it, right and down, each -1 to 1, of world directions (..., 3). The pose is
    level and faces +y."""
    wx, wy, wz = np.moveaxis(np.asarray(ways, np.float64), -1, 0)
    x, y, z = wx, -wz, wy  # right, down, ahead
    size = np.stack([abs(x), abs(y), abs(z)])
    axis, most = size.argmax(axis=0), np.maximum(size.max(axis=0), 1e-300)
    face = np.select(
        [(axis == 2) & (z > 0), axis == 2, (axis == 0) & (x > 0), axis == 0, y < 0],
        [FRONT, BACK, RIGHT, LEFT, UP],
        DOWN,
    )
    right = np.select([face == FRONT, face == RIGHT, face == LEFT], [x, -z, z], -x) / most
    down = np.select([face == UP, face == DOWN], [-z, z], y) / most
    return face, right, down


def sample_strip(strip: NDArray[np.generic], ways: NDArray[np.floating]) -> NDArray[np.float32]:
    """(..., 3) float32 colors of a strip (S, 6 S, 3) along world directions (..., 3), bilinear, clamped to each
    face."""
    side = strip.shape[0]
    face, right, down = place_on_strip(ways)
    column, row = ((1 + right) / 2 * side - 0.5).clip(0, side - 1), ((1 + down) / 2 * side - 0.5).clip(0, side - 1)
    c0, r0 = (np.minimum(v.astype(np.int64), side - 2) for v in (column, row))
    fc, fr = (column - c0)[..., None].astype(np.float32), (row - r0)[..., None].astype(np.float32)
    left = face * side + c0
    top = strip[r0, left] * (1 - fc) + strip[r0, left + 1] * fc
    bottom = strip[r0 + 1, left] * (1 - fc) + strip[r0 + 1, left + 1] * fc
    return np.asarray(top * (1 - fr) + bottom * fr, np.float32)


def pixels_along(side: int, ways: NDArray[np.floating]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Row and column (...) of the pixels that directions (..., 3) hit, in a strip with faces of `side` pixels."""
    face, right, down = place_on_strip(ways)
    column, row = (np.floor((1 + v) / 2 * side).clip(0, side - 1).astype(np.int64) for v in (right, down))
    return row, face * side + column
