"""Detects transients by a running error per block of every view: blocks whose error stays large are masked.

Splatfacto-W masks a share of each image that depends only on the mean error. Here every view keeps the error of each of
its blocks over its visits. A block is masked while its error is large, both in absolute terms and relative to the other
blocks of the image. The error is that of the block's mean color. Books on a shelf that are still blurred have the
correct mean; if masked, they would never become sharp. A person before a wall has a wrong mean. As in Splatfacto-W
every part of the image can be masked (never_mask_upper = 0), and at most 40 % of it. On masked floor, the error is the
background's.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.training.config import RobustConfig

BLOCK = 8
"""Side of a block in pixels of the full-size image."""
MEMORY = 0.5
"""Share of the running error that each visit keeps."""
Float32 = NDArray[np.float32]


@njit(parallel=True, cache=True, fastmath=True)
def _block_means(
    error: Float32,  # (3, H, W) drawn minus true color
    blocks: Float32,  # (rows, columns) out: the error of the mean color
) -> None:
    _, height, width = error.shape
    rows, columns = blocks.shape
    for r in prange(rows):
        y0, y1 = r * height // rows, (r + 1) * height // rows
        for c in range(columns):
            x0, x1 = c * width // columns, (c + 1) * width // columns
            wrong = np.float32(0)
            for channel in range(3):
                total = np.float32(0)
                for y in range(y0, y1):
                    for x in range(x0, x1):
                        total += error[channel, y, x]
                wrong += abs(total)
            blocks[r, c] = wrong / np.float32(max(3 * (y1 - y0) * (x1 - x0), 1))


@njit(parallel=True, cache=True)
def _spread(
    outliers: NDArray[np.uint8],  # (rows, columns) 1 for masked blocks
    inlier: NDArray[np.bool_],  # (H, W) out
) -> None:
    height, width = inlier.shape
    rows, columns = outliers.shape
    for r in prange(rows):
        for y in range(r * height // rows, (r + 1) * height // rows):
            for c in range(columns):
                keep = outliers[r, c] == 0
                for x in range(c * width // columns, (c + 1) * width // columns):
                    inlier[y, x] = keep


class BlockMask:
    """The running errors of `count` views. `errors` (count, rows, columns) is its whole state; -1 for unseen blocks."""

    def __init__(self, config: RobustConfig, steps: int, count: int, width: int, height: int) -> None:
        self._config, self._steps = config, steps
        self.errors = np.full((count, max(height // BLOCK, 1), max(width // BLOCK, 1)), -1, np.float32)

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> None:
        """Writes `inlier` (H, W), of any size, from the errors of earlier visits to `view`; `image` (H, W, 3) is
        unused."""
        if step > self._config.start * self._steps:
            _spread(self.outliers(view), inlier)

    def end(self, view: int, error: Float32) -> None:
        """Adds the error (3, H, W) of a visit to `view`, drawn minus true color, at any size."""
        seen = np.empty(self.errors.shape[1:], np.float32)
        _block_means(error, seen)
        known = self.errors[view]
        self.errors[view] = np.where(known < 0, seen, MEMORY * known + (1 - MEMORY) * seen)

    def outliers(self, view: int) -> NDArray[np.uint8]:
        """(rows, columns) uint8, 1 for masked blocks: outliers that fill a square of 3 by 3 blocks, and the blocks
        beside them. Thin outliers are not masked, because they are edges that do not fit yet."""
        c, errors = self._config, self.errors[view]
        limit = max(c.threshold, c.factor * float(np.median(errors)), float(np.quantile(errors, 1 - c.most)))
        found = (errors > limit).astype(np.uint8)
        if not found.any():
            return found
        square = np.ones((3, 3), np.uint8)
        whole = cv2.morphologyEx(found, cv2.MORPH_OPEN, square, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.dilate(whole, square), np.uint8)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """The running errors (count, rows, columns) by name."""
        return {"errors": self.errors}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` of `state`, (count, rows, columns)."""
        self.errors[:] = arrays["errors"]
