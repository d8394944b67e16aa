"""The census transform: which pixels around one are clearly brighter or darker than it. It does not change with
exposure, and in a bare region, where only noise differs, it says nothing (Zabih and Woodfill, 1994)."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

_AROUND = np.array(
    [(dy, dx) for dy in (-3, -1, 0, 1, 3) for dx in (-4, -2, -1, 0, 1, 2, 4) if dy or abs(dx) in (1, 2)], np.int64
)
"""(32, 2) rows and columns of the pixels that are compared with the one in the middle."""


@njit(cache=True, nogil=True)
def census(gray: NDArray[np.float32], threshold: float, offsets: NDArray[np.int64]) -> NDArray[np.uint64]:
    """(H, W) uint64 of `gray` (H, W) float32: two bits for each of `offsets` (N <= 32, 2), brighter and darker by more
    than `threshold` grey levels. Beyond the border the border counts."""
    height, width = gray.shape
    out = np.empty((height, width), np.uint64)
    for y in range(height):
        for x in range(width):
            middle = gray[y, x]
            bits = np.uint64(0)
            for i in range(offsets.shape[0]):
                v = min(max(y + offsets[i, 0], 0), height - 1)
                u = min(max(x + offsets[i, 1], 0), width - 1)
                difference = gray[v, u] - middle
                bits = bits << np.uint64(2)
                if difference > threshold:
                    bits |= np.uint64(1)
                elif difference < -threshold:
                    bits |= np.uint64(2)
            out[y, x] = bits
    return out


def census_of(gray: NDArray[np.float32], threshold: float) -> NDArray[np.uint64]:
    """`census` over the neighbourhood of 9 x 7 pixels that the sweep uses."""
    return np.asarray(census(gray, threshold, _AROUND))
