"""Argument and result types of the kernels, the columns of a splat, which is one Gaussian on the image, and their
camera.

All kernels use one cache line of 16 floats for a splat. Real numbers are np.float32 throughout: one Python float
would widen all values combined with it to double precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera

TILE_BITS = 4
TILE = 1 << TILE_BITS
"""Side of a tile in pixels: one row is one AVX-512 register, or two of AVX2."""

X, Y = 0, 1
"""Center in pixels, with the center of the first pixel at (0, 0)."""
CONIC_A, CONIC_B, CONIC_C, LOG_OPACITY = 2, 3, 4, 5
"""log2 alpha = A dx^2 + B dx dy + C dy^2 + LOG_OPACITY; the base 2 saves a multiplication per pixel."""
RED, GREEN, BLUE = 6, 7, 8
DEPTH = 9
NORMAL = 10
HALF_WIDTH, HALF_HEIGHT = 13, 14
"""Half extents in pixels of the ellipse in which alpha is at least 1/255."""
OPACITY = 15
WIDTH = 16

LOG_CUT = np.float32(math.log2(1 / 255))
"""log2 of the least alpha that is drawn."""
ALPHA_MAX = np.float32(0.99)
"""Greatest alpha, so that the backward pass can divide by 1 - alpha."""
T_STOP = np.float32(1e-4)
"""Transmittance at which a tile is finished: no pixel of it has more."""


Float32 = NDArray[np.float32]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
UInt32 = NDArray[np.uint32]
UInt64 = NDArray[np.uint64]
Mask = NDArray[np.bool_]

Whole = int | np.int64
"""A whole number: Python's int in calls from Python, numba's type if a kernel computed it."""

Vector3 = tuple[np.float32, np.float32, np.float32]
Quaternion = tuple[np.float32, np.float32, np.float32, np.float32]
"""w, x, y, z."""
Matrix3 = tuple[
    np.float32, np.float32, np.float32, np.float32, np.float32, np.float32, np.float32, np.float32, np.float32
]
"""The entries of a 3x3 matrix by rows. Tuples stay in registers; arrays would use memory."""


EPS2D = 0.3
"""Variance of the pixel's low-pass filter, pixels squared."""
NEAR = 0.05
"""Distance along the optical axis below which Gaussians are not drawn, by their center; meters."""
_MARGIN = 0.15
# The affine approximation is computed at most this share of the image size outside the image, as is common: farther out
# it enlarges Gaussians without bound.


def pack(camera: Camera, antialiased: bool) -> NDArray[np.float32]:
    """The camera as the (33,) float32 row for the kernels: rotation and translation of world to camera, focal lengths,
    principal point, size, limits of x/z and y/z, camera position. Then filter variance, whether opacity is compensated,
    nearest depth, how much the slopes can enlarge a Gaussian, and the first and last requested pixel of a row and of a
    column (see `limit`)."""
    k = camera.intrinsics
    view = np.empty(33, np.float32)
    view[0:9] = camera.world_to_camera[:3, :3].reshape(-1)
    view[9:12] = camera.world_to_camera[:3, 3]
    view[12:18] = k.fx, k.fy, k.cx, k.cy, k.width, k.height
    view[18:20] = -(k.cx + _MARGIN * k.width) / k.fx, (k.width - k.cx + _MARGIN * k.width) / k.fx
    view[20:22] = -(k.cy + _MARGIN * k.height) / k.fy, (k.height - k.cy + _MARGIN * k.height) / k.fy
    view[22:25] = camera.position
    view[25:28] = EPS2D, antialiased, NEAR
    # Rows of the Jacobian are at most this long, times focal / z.
    view[28] = np.sqrt(1 + max(view[18] ** 2, view[19] ** 2, view[20] ** 2, view[21] ** 2))
    view[29:33] = 0, k.width - 1, 0, k.height - 1
    return view


def limit(view: NDArray[np.float32], tiles: NDArray[np.bool_]) -> None:
    """Limits a packed camera `view` (33,) to the bounding box of the requested `tiles` (lines, columns)."""
    lines, columns = np.flatnonzero(tiles.any(axis=1)), np.flatnonzero(tiles.any(axis=0))
    if len(lines) == 0:
        view[29:33] = 0, -1, 0, -1
        return
    view[29], view[30] = columns[0] * TILE, min(view[30], columns[-1] * TILE + TILE - 1)
    view[31], view[32] = lines[0] * TILE, min(view[32], lines[-1] * TILE + TILE - 1)
