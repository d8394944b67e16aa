"""The exposure of every training image: a camera that meters as it goes photographs one wall in many brightnesses,
which no scene can explain.

A gain per image and channel takes them out of the scene while it is learned. The gains are held near one, and are no
part of the model: what is drawn afterwards has the exposure that the images agree on.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.training.optimizer import BETA1, BETA2

_F = np.float32
HOLD = 1e-3
"""Weight of half the squared logarithm of every gain."""
Float32 = NDArray[np.float32]


@njit(parallel=True, cache=True, fastmath=True)
def _apply(
    gain: Float32,  # (3,)
    rgb: Float32,  # (H, W, 3) changed
    background: Float32,  # (3, H, W) changed
) -> None:
    height, width, _ = rgb.shape
    for y in prange(height):
        for x in range(width):
            for c in range(3):
                rgb[y, x, c] *= gain[c]
        for c in range(3):
            for x in range(width):
                background[c, y, x] *= gain[c]


@njit(parallel=True, cache=True, fastmath=True)
def _apply_gradient(
    gain: Float32,  # (3,)
    rgb: Float32,  # (H, W, 3) as exposed
    background: Float32,  # (3, H, W) as exposed
    d_rgb: Float32,  # (H, W, 3) changed
    d_background: Float32,  # (3, H, W) changed
    rows: Float32,  # (H, 3) out: the gradient by the logarithm of the gain, row by row
) -> None:
    # The images come as they were exposed, so that their sums are already by the logarithm of the gain.
    height, width, _ = rgb.shape
    for y in prange(height):
        for c in range(3):
            total = _F(0)
            for x in range(width):
                total += d_rgb[y, x, c] * rgb[y, x, c] + d_background[c, y, x] * background[c, y, x]
                d_rgb[y, x, c] *= gain[c]
                d_background[c, y, x] *= gain[c]
            rows[y, c] = total


class Exposure:
    """log_gains (views, 3) float32, with the moments of an Adam that moves only the row of the view at hand: a view is
    seen a dozen times in a short training, and every visit has to count."""

    def __init__(self, views: int, rate: float) -> None:
        self._rate = rate
        self.log_gains = np.zeros((views, 3), np.float32)
        self._first, self._second = np.zeros((views, 3)), np.zeros((views, 3))
        self._visits = np.zeros(views, np.int64)

    def apply(self, view: int, rgb: Float32, background: Float32) -> None:
        """Exposes rgb (H, W, 3) and background (3, H, W) as the view was, in place."""
        _apply(np.exp(self.log_gains[view]), rgb, background)

    def learn(
        self,
        view: int,
        rgb: Float32,
        background: Float32,
        d_rgb: Float32,
        d_background: Float32,
    ) -> None:
        """Turns gradients by the exposed images (what `apply` made) into those by the unexposed ones, in place, and
        moves the view's gains."""
        rows = np.empty((rgb.shape[0], 3), np.float32)
        _apply_gradient(np.exp(self.log_gains[view]), rgb, background, d_rgb, d_background, rows)
        slope = rows.sum(axis=0, dtype=np.float64) + HOLD * self.log_gains[view]
        self._visits[view] += 1
        self._first[view] = BETA1 * self._first[view] + (1 - BETA1) * slope
        self._second[view] = BETA2 * self._second[view] + (1 - BETA2) * slope**2
        first = self._first[view] / (1 - BETA1 ** self._visits[view])
        second = self._second[view] / (1 - BETA2 ** self._visits[view])
        self.log_gains[view] -= (self._rate * first / (np.sqrt(second) + 1e-15)).astype(np.float32)

    def state(self) -> dict[str, NDArray[np.generic]]:
        """Everything that `learn` changes, by name."""
        return {
            "exposure.log_gains": self.log_gains,
            "exposure.first": self._first,
            "exposure.second": self._second,
            "exposure.visits": self._visits,
        }

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """The inverse of `state`."""
        for name, array in self.state().items():
            array[:] = arrays[name]
