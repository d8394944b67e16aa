"""Splatfacto-W's robust mask: a share of the worst pixels of each image, which depends on the image's mean error.

The share is 0 at the smallest mean error so far and `most` at the largest; the largest is reset from time to time. A
pixel among the worst counts as inlier if more than 40 % of its 5x5 neighborhood are inliers. Splatfacto-W never masks
the upper part of an image (`never_mask_upper`, for skies); here no part is exempt.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.training.config import RobustConfig

WINDOW = 5
VOTE = 0.4
"""Share of inliers among a pixel's neighbors that makes it an inlier."""
Float32 = NDArray[np.float32]
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
