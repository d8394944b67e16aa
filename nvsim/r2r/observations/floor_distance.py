"""Distances to the floor along rays, which give the depth where a floor-aware model has no Gaussians."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange

from nvsim.geometry.camera import Camera
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.arithmetic import FLAGS
from nvsim.render.floor_texture import distance_to_floor, pack_floor
from nvsim.render.kernel_types import Float32
from nvsim.render.workspace import LOCK

SOLID = np.float32(0.5)
"""If alpha is at least this, a ray that meets the floor ends at the Gaussians in front of it."""
VEIL = np.float32(0.1)
"""The same limit for a ray that does not meet the floor. It is lower, because ceilings in few images have low alpha and
nothing else is behind them."""

_F = np.float32
_HALF, _ONE = _F(0.5), _F(1)


@njit(parallel=True, cache=True, nogil=True, fastmath=FLAGS, error_model="numpy")
def _settle(
    solid: Float32,  # (H, W, 2) alpha, and alpha times meters along the ray
    rotation: Float32,  # (3, 3) columns right, down and ahead, world
    eye: Float32,  # (3,) meters, world
    focal: np.float32,  # pixels
    heights: Float32,  # the floor, see `pack_floor`
    grid: Float32,
    metres: Float32,  # (H, W) output
) -> None:
    height, width = metres.shape
    for row in prange(height):
        b = (_F(row) + _HALF - _F(height) * _HALF) / focal
        for column in range(width):
            alpha = solid[row, column, 0]
            if alpha >= SOLID:
                metres[row, column] = solid[row, column, 1] / alpha
                continue
            a = (_F(column) + _HALF - _F(width) * _HALF) / focal
            n = _ONE / math.sqrt(a * a + b * b + _ONE)
            x = (rotation[0, 0] * a + rotation[0, 1] * b + rotation[0, 2]) * n
            y = (rotation[1, 0] * a + rotation[1, 1] * b + rotation[1, 2]) * n
            z = (rotation[2, 0] * a + rotation[2, 1] * b + rotation[2, 2]) * n
            distance = distance_to_floor(heights, grid, eye[0], eye[1], eye[2], x, y, z)
            if distance < _F(0):
                distance = solid[row, column, 1] / alpha if alpha >= VEIL else _F(0)
            metres[row, column] = distance


def distances(solid: Float32, camera: Camera, floor: FloorSurface) -> Float32:
    """Computes (H, W) float32 meters along the rays of `camera`, 0 where they meet no surface.

    `solid` (H, W, 2) is alpha, and alpha times the Gaussians' distance in meters. If alpha is at least 0.5, the
    distance is that of the Gaussians, else that of the floor. A mean of both would be a point in the air wherever
    Gaussians of low alpha are above the floor.
    """
    metres = np.empty(solid.shape[:2], np.float32)
    heights, grid = pack_floor(floor)
    rotation, eye = (np.ascontiguousarray(v, np.float32) for v in (camera.rotation, camera.position))
    with LOCK:
        _settle(solid, rotation, eye, np.float32(camera.intrinsics.fx), heights, grid, metres)
    return metres
