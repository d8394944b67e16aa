"""Which pixels are transients: a running error per block of every view, and the blocks that stay wrong.

Splatfacto-W masks a share of each image that follows the mean error, whatever the picture shows. Here a view keeps the
error of each of its blocks over its visits, and a block is left out while its error is large both in absolute terms and
against the other blocks of the image. It is the error of the block's mean colour that counts: books on a shelf that are
still blurred have the right mean, and would never become sharp if they were masked; a person before a wall has not. As
in Splatfacto-W every part of the image may be masked (never_mask_upper = 0) and at most 40 % of it. Where the mask says
floor, the error is the background's.
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
    error: Float32,  # (3, H, W) drawn minus true colour
    blocks: Float32,  # (rows, columns) out: the error of the mean colour
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
    outliers: NDArray[np.uint8],  # (rows, columns) 1 where a block is masked
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
    """The running errors of `count` views. `errors` (count, rows, columns) is all its state; -1 where never seen."""

    def __init__(self, config: RobustConfig, steps: int, count: int, width: int, height: int) -> None:
        self._config, self._steps = config, steps
        self.errors = np.full((count, max(height // BLOCK, 1), max(width // BLOCK, 1)), -1, np.float32)

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> None:
        """Writes `inlier` (H, W), at any size, from what earlier visits to `view` found."""
        if step > self._config.start * self._steps:
            _spread(self.outliers(view), inlier)

    def end(self, view: int, error: Float32) -> None:
        """Takes in the error (3, H, W) of a visit to `view`, drawn minus true colour, at any size."""
        seen = np.empty(self.errors.shape[1:], np.float32)
        _block_means(error, seen)
        known = self.errors[view]
        self.errors[view] = np.where(known < 0, seen, MEMORY * known + (1 - MEMORY) * seen)

    def outliers(self, view: int) -> NDArray[np.uint8]:
        """(rows, columns), 1 where a block is masked: outliers that fill a square of 3 by 3 blocks, as the seams of
        what does not fit yet are thin, and the blocks beside them."""
        c, errors = self._config, self.errors[view]
        limit = max(c.threshold, c.factor * float(np.median(errors)), float(np.quantile(errors, 1 - c.most)))
        found = (errors > limit).astype(np.uint8)
        if not found.any():
            return found
        square = np.ones((3, 3), np.uint8)
        whole = cv2.morphologyEx(found, cv2.MORPH_OPEN, square, borderType=cv2.BORDER_REPLICATE)
        return np.asarray(cv2.dilate(whole, square), np.uint8)

    def state(self) -> dict[str, NDArray[np.generic]]:
        return {"errors": self.errors}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        self.errors[:] = arrays["errors"]
