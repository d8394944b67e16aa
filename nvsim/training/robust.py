"""Robust masks, which leave pixels with transients out of training: by blocks of a view, or by a quantile of each
image.

Splatfacto-W masks a share of each image that depends only on the mean error. Here every view keeps the error of each
of its blocks over its visits. A block is masked while its error is large, both in absolute terms and relative to the
other blocks of the image. The error is that of the block's mean color. Books on a shelf that are still blurred have
the correct mean; if masked, they would never become sharp. A person before a wall has a wrong mean. As in
Splatfacto-W every part of the image can be masked (never_mask_upper = 0), and at most 40 % of it. On masked floor,
the error is the background's.

The share is 0 at the smallest mean error so far and `most` at the largest; the largest is reset from time to time. A
pixel among the worst counts as inlier if more than 40 % of its 5x5 neighborhood are inliers. Splatfacto-W never masks
the upper part of an image (`never_mask_upper`, for skies); here no part is exempt.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit, prange
from nvsim.training.config import RobustConfig, TrainingConfig

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


WINDOW = 5
VOTE = 0.4
"""Share of inliers among a pixel's neighbors that makes it an inlier."""
Judge = Callable[[Float32, Float32, Float32], None]


@njit(parallel=True, cache=True, fastmath=True)
def _errors(
    rgb: Float32,  # (H, W, 3) colors of the Gaussians, 0 to 1
    transmittance: Float32,  # (H, W)
    background: Float32,  # (3, H, W) colors, 0 to 1
    image: NDArray[np.uint8],  # (H, W, 3)
    error: Float32,  # (H, W) out: mean absolute error of the channels
) -> None:
    height, width = transmittance.shape
    for y in prange(height):
        for x in range(width):
            total = np.float32(0)
            for c in range(3):
                drawn = rgb[y, x, c] + transmittance[y, x] * background[c, y, x]
                total += abs(drawn - np.float32(image[y, x, c]) * np.float32(1 / 255))
            error[y, x] = total * np.float32(1 / 3)


class QuantileMask:
    """A robust mask; `extremes` (2,), the largest mean error since the last reset and the smallest, is its whole
    state."""

    def __init__(self, config: RobustConfig, steps: int) -> None:
        self._config, self._steps = config, steps
        self._renewal = max(int(config.renewal * steps), 1)
        self.extremes = np.array([0.0, np.inf])

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> Judge:
        """Returns the function that writes `inlier` (H, W) in `step` (from 1) after `image` (H, W, 3) is drawn."""

        def judge(rgb: Float32, transmittance: Float32, background: Float32) -> None:
            self._judge(step, rgb, transmittance, background, image, inlier)

        return judge

    def end(self, view: int, error: Float32) -> None:
        """Does nothing, because the mask is written when the image is drawn; `error` is (3, H, W)."""

    def state(self) -> dict[str, NDArray[np.generic]]:
        """The extremes (2,) by name."""
        return {"extremes": self.extremes}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` of `state`, (2,)."""
        self.extremes[:] = arrays["extremes"]

    def _judge(
        self,
        step: int,
        rgb: Float32,
        transmittance: Float32,
        background: Float32,
        image: NDArray[np.uint8],
        inlier: NDArray[np.bool_],
    ) -> None:
        error = np.empty(transmittance.shape, np.float32)
        _errors(rgb, transmittance, background, image, error)
        error[~inlier] = 0  # unusable pixels have no error
        mean = float(error.mean())
        if step % self._renewal == 0:
            self.extremes[0] = 0.0
        self.extremes[:] = max(self.extremes[0], mean), min(self.extremes[1], mean)
        if step > self._config.start * self._steps:
            inlier[:] = inliers(error, self.share(mean))

    def share(self, mean: float) -> float:
        """The share of pixels among the worst in an image with this mean error."""
        largest, smallest = self.extremes
        return float((mean - smallest) / (largest - smallest + 1e-6) * self._config.most)


def inliers(error: Float32, share: float) -> NDArray[np.bool_]:
    """(H, W) bool: pixels that are not among the `share` with the largest `error` (H, W), and pixels surrounded by
    them."""
    good = error <= np.quantile(error, 1 - share)
    # Pixels outside the image are no inliers: Splatfacto-W's convolution pads with zeros.
    votes = cv2.blur(good.astype(np.float32), (WINDOW, WINDOW), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(good | (votes > VOTE))


"""A function that gets the color of the Gaussians (H, W, 3), the transmittance (H, W), and the background (3, H, W) of
the view just drawn."""


class RobustMask(Protocol):
    """A mask of transients, updated in every step."""

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> Judge | None:
        """Called before view number `view` is drawn in `step` (from 1). Writes `inlier` (H, W), or returns a function
        that writes it after the image (H, W, 3) is drawn. Initially `inlier` contains the usable pixels; the others
        never count."""
        ...

    def end(self, view: int, error: Float32) -> None:
        """Called after the step with `error` (3, H, W), drawn minus true color."""
        ...

    def state(self) -> dict[str, NDArray[np.generic]]:
        """All arrays that a step changes, by name, of any shape."""
        ...

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` of `state`, of any shape."""
        ...


class NoMask(RobustMask):
    """A robust mask that keeps every pixel."""

    def begin(self, step: int, view: int, image: NDArray[np.uint8], inlier: NDArray[np.bool_]) -> None:
        return None

    def end(self, view: int, error: Float32) -> None:
        return None

    def state(self) -> dict[str, NDArray[np.generic]]:
        return {}

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        return None


def robust_mask(config: TrainingConfig, count: int, width: int, height: int) -> RobustMask:
    """The mask of a configuration for `count` views. The first one has `width` x `height` pixels."""
    match config.robust.kind:
        case "blocks":
            return BlockMask(config.robust, config.steps, count, width, height)
        case "quantile":
            return QuantileMask(config.robust, config.steps)
        case "none":
            return NoMask()
