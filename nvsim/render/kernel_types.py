"""Argument and result types of the kernels. Real numbers are np.float32 throughout: one Python float would widen all
values combined with it to double precision."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

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
