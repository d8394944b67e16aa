"""The colors of the floor in a capture, as evidence for a network that does not know such rooms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from nvsim.perception.roles import Float32

_BINS = (8, 32, 32)  # of luminance, and of red and blue against green
_SPREAD = (0.7, 1.2, 1.2)  # bins, standard deviation of the smoothing
_DARK = 10.0  # added before the logarithm, so that noise in dark pixels does not count as color
_REACH = 1.6  # largest log ratio of red or blue to green
_RARE = 3e-5  # share of the pixels below which a color is as good as unseen


@dataclass(frozen=True, eq=False)
class FloorColors:
    """How much more frequent each color is on floor than on other surfaces.

    odds  (8, 32, 32) float32, natural logarithm of the ratio of both shares, by luminance and two chromaticities
    """

    odds: Float32

    @staticmethod
    def learn(colors: NDArray[np.number], is_floor: NDArray[np.bool_]) -> FloorColors:
        """The colors of pixels (N, 3) RGB, 0 to 255, that are floor or not (N,). Both kinds must occur."""
        shares = []
        for chosen in (is_floor, ~is_floor):
            counts = np.zeros(_BINS)
            np.add.at(counts, _bins_of(colors[chosen]), 1.0)
            shares.append(gaussian_filter(counts / chosen.sum(), _SPREAD) + _RARE)
        return FloorColors(np.log(shares[0] / shares[1]).astype(np.float32))

    def log_odds(self, colors: NDArray[np.number]) -> Float32:
        """(...) float32 evidence of pixels (..., 3) RGB, 0 to 255: above 0 for the colors of floor."""
        return np.asarray(self.odds[_bins_of(colors)], np.float32)


def _bins_of(colors: NDArray[np.number]) -> tuple[NDArray[np.int64], ...]:
    logs = np.log(np.asarray(colors, np.float32) + np.float32(_DARK))
    brightest = np.log((255 + _DARK) / _DARK)
    shares = (
        (logs.mean(axis=-1) - np.log(_DARK)) / brightest,
        (logs[..., 0] - logs[..., 1]) / (2 * _REACH) + 0.5,
        (logs[..., 2] - logs[..., 1]) / (2 * _REACH) + 0.5,
    )
    return tuple(np.clip(share * bins, 0, bins - 1).astype(np.int64) for share, bins in zip(shares, _BINS, strict=True))
