"""The census transform: which pixels around a pixel are clearly brighter or darker (Zabih and Woodfill, 1994).

It does not change with exposure. In a uniform region, where only noise differs, it carries no information."""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit
from numpy.typing import NDArray

NOTHING = np.uint64(0xFFFFFFFFFFFFFFFF)
"""The census of a pixel that is not seen or must not be used. Half of its bits differ from any other census."""
_UP, _LEFT = 3, 4
_AROUND = np.array(
    [(dy, dx) for dy in (-3, -1, 0, 1, 3) for dx in (-4, -2, -1, 0, 1, 2, 4) if dy or abs(dx) in (1, 2)], np.int64
)
"""(32, 2) row and column offsets of the pixels that are compared with the center pixel."""


@njit(cache=True, nogil=True, error_model="numpy")
def _compared(
    padded: NDArray[np.float32], threshold: np.float32, offsets: NDArray[np.int64], out: NDArray[np.uint64]
) -> None:
    """Fill `out` (H, W). `padded` has `_UP` more rows and `_LEFT` more columns on every side. The loops run row by row
    with unsigned indices, so that LLVM vectorizes them."""
    for y in range(out.shape[0]):
        middle, to = padded[y + _UP], out[y]
        to[:] = 0
        for i in range(offsets.shape[0]):
            row, shift = padded[y + _UP + offsets[i, 0]], np.uintp(offsets[i, 1] + _LEFT)
            for j in range(out.shape[1]):
                x = np.uintp(j)
                difference = row[x + shift] - middle[x + np.uintp(_LEFT)]
                brighter = np.uint64(1) if difference > threshold else np.uint64(0)
                darker = np.uint64(2) if difference < -threshold else np.uint64(0)
                to[x] = (to[x] << np.uint64(2)) | brighter | darker


def census_of(grey: NDArray[np.float32], threshold: float) -> NDArray[np.uint64]:
    """(H, W) uint64 census of `grey` (H, W) float32.

    It has two bits for each of 32 pixels in a 9 x 7 neighborhood: brighter and darker by more than `threshold` gray
    levels. Border pixels are replicated. A negative gray value marks a pixel that must not be used. If the neighborhood
    of a pixel contains one, its census is `NOTHING`."""
    padded = cv2.copyMakeBorder(grey, _UP, _UP, _LEFT, _LEFT, cv2.BORDER_REPLICATE)
    out = np.empty(grey.shape, np.uint64)
    _compared(np.asarray(padded, np.float32), np.float32(threshold), _AROUND, out)
    ignored = (grey < 0).astype(np.uint8)
    if ignored.any():
        out[cv2.dilate(ignored, np.ones((2 * _UP + 1, 2 * _LEFT + 1), np.uint8)) > 0] = NOTHING
    return out
