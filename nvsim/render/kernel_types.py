"""Argument and result types of the kernels, and the columns of a splat, which is one Gaussian on the image.

All kernels use one cache line of 16 floats for a splat. Real numbers are np.float32 throughout: one Python float would
widen all values combined with it to double precision.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

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
