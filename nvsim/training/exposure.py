"""The exposure of every training image. A camera with automatic exposure records one wall with many brightnesses, which
a static scene cannot explain.

A learned gain per image and channel removes these differences during training. The gains are kept near one and are not
part of the model. Rendered views have the average exposure of the images.
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
    rgb: Float32,  # (H, W, 3) with exposure
    background: Float32,  # (3, H, W) with exposure
    d_rgb: Float32,  # (H, W, 3) changed
    d_background: Float32,  # (3, H, W) changed
    rows: Float32,  # (H, 3) out: the gradient of the logarithm of the gain, row by row
) -> None:
    # The images include the exposure, so their sums are already gradients of the logarithm of the gain.
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
    """log_gains (views, 3) float32, with the moments of an Adam optimizer that changes only the row of the current
    view. In a short training a view is seen a dozen times, so every visit must have an effect."""

    def __init__(self, views: int, rate: float) -> None:
        self._rate = rate
        self.log_gains = np.zeros((views, 3), np.float32)
        self._first, self._second = np.zeros((views, 3)), np.zeros((views, 3))
        self._visits = np.zeros(views, np.int64)

    def apply(self, view: int, rgb: Float32, background: Float32) -> None:
        """Multiplies rgb (H, W, 3) and background (3, H, W) by the gains of the view, in place."""
        _apply(np.exp(self.log_gains[view]), rgb, background)

    def learn(
        self,
        view: int,
        rgb: Float32,
        background: Float32,
        d_rgb: Float32,
        d_background: Float32,
    ) -> None:
        """Converts gradients of the exposed images (of `apply`) to those of the unexposed ones, in place, and updates
        the view's gains. `rgb` and `d_rgb` are (H, W, 3), `background` and `d_background` (3, H, W)."""
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
        """All arrays that `learn` changes, by name: (views, 3), and the visits (views,)."""
        return {
            "exposure.log_gains": self.log_gains,
            "exposure.first": self._first,
            "exposure.second": self._second,
            "exposure.visits": self._visits,
        }

    def restore(self, arrays: dict[str, NDArray[np.generic]]) -> None:
        """Restores the `arrays` of `state`: (views, 3), and the visits (views,)."""
        for name, array in self.state().items():
            array[:] = arrays[name]
