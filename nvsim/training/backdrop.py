"""The background at every pixel of a view, from its 25 SH coefficients and the floor texture, and the way back.

Both directions evaluate the basis again, one row of pixels at a time: that costs less than keeping 25 planes.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.splats import harmonics

_F = np.float32
_terms = njit(inline="always")(harmonics.terms)
COEFFICIENTS = 25


def pack_camera(camera: Camera) -> NDArray[np.float32]:
    """(16,) float32 for the kernels: rotation of camera to world by rows, position, focal lengths, principal point."""
    k = camera.intrinsics
    packed = np.empty(16, np.float32)
    packed[0:9], packed[9:12] = camera.rotation.reshape(-1), camera.position
    packed[12:16] = k.fx, k.fy, k.cx, k.cy
    return packed


@njit(inline="always")
def _basis_row(camera: Any, y: Any, width: Any, row: Any) -> None:
    v = (_F(y) + _F(0.5) - camera[15]) / camera[13]
    for x in range(width):
        u = (_F(x) + _F(0.5) - camera[14]) / camera[12]
        length = _F(1) / np.sqrt(u * u + v * v + _F(1))
        dx = (camera[0] * u + camera[1] * v + camera[2]) * length
        dy = (camera[3] * u + camera[4] * v + camera[5]) * length
        dz = (camera[6] * u + camera[7] * v + camera[8]) * length
        values = _terms(dx, dy, dz)
        row[0, x], row[1, x], row[2, x], row[3, x], row[4, x] = values[0], values[1], values[2], values[3], values[4]
        row[5, x], row[6, x], row[7, x], row[8, x], row[9, x] = values[5], values[6], values[7], values[8], values[9]
        row[10, x], row[11, x], row[12, x], row[13, x] = values[10], values[11], values[12], values[13]
        row[14, x], row[15, x], row[16, x], row[17, x] = values[14], values[15], values[16], values[17]
        row[18, x], row[19, x], row[20, x], row[21, x] = values[18], values[19], values[20], values[21]
        row[22, x], row[23, x], row[24, x] = values[22], values[23], values[24]


@njit(parallel=True, cache=True, fastmath=True)
def evaluate(camera: Any, coefficients: Any, out: Any) -> None:
    """`out` (3, H, W) = the SH background along every pixel's ray; `coefficients` (25, 3)."""
    _, height, width = out.shape
    for y in prange(height):
        basis = np.empty((COEFFICIENTS, width), np.float32)
        _basis_row(camera, y, width, basis)
        for c in range(3):
            line = out[c, y]
            line[:] = _F(0)
            for k in range(COEFFICIENTS):
                factor, values = coefficients[k, c], basis[k]
                for x in range(width):
                    line[x] += factor * values[x]


@njit(parallel=True, cache=True, fastmath=True)
def evaluate_gradient(camera: Any, d_background: Any, rows: Any) -> None:
    """`rows` (H, 25, 3): what each row of pixels adds to the gradient by the coefficients (25, 3)."""
    _, height, width = d_background.shape
    for y in prange(height):
        basis = np.empty((COEFFICIENTS, width), np.float32)
        _basis_row(camera, y, width, basis)
        for k in range(COEFFICIENTS):
            values = basis[k]
            for c in range(3):
                line = d_background[c, y]
                total = _F(0)
                for x in range(width):
                    total += values[x] * line[x]
                rows[y, k, c] = total
