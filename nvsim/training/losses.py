"""The floor-aware loss of one view and its gradients by the drawn colour, alpha and background (paper, section III-C).

    I_hat = I_GS + (1 - alpha) * I_BG
    L = (1 - lambda_s) |w (I_hat - I)| + lambda_s (1 - SSIM(w I_hat, w I))
      + lambda_supp |M alpha| + lambda_bg M inlier * smooth(I_BG - I) + lambda_fill (1 - M) inlier (1 - alpha)

with M the floor mask, w = inlier and not M (every inlier where no term treats the floor in its own way), and
smooth(x) = sqrt(x^2 + 1e-4): with plain L1 Adam leaves coloured noise on the floor. Every term is a mean over all
pixels of the image (and channels).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.training.config import LossConfig
from nvsim.training.ssim import TAPS, ssim_backward, ssim_forward

_F = np.float32
_BYTE = _F(1 / 255)
SMOOTH = _F(1e-4)

Float32 = NDArray[np.float32]


@njit(parallel=True, cache=True, fastmath=True)
def _compose(
    rgb: Any,
    alpha: Any,
    background: Any,
    image: Any,
    floor: Any,
    inlier: Any,
    floor_aware: Any,
    predicted: Any,
    target: Any,
    error: Any,
    sums: Any,
) -> None:
    # Per row: planar weighted prediction and target for the SSIM, the error of every pixel (of the
    # background where the mask says floor), and the sums of every other term.
    height, width = alpha.shape
    for y in prange(height):
        total, squares, counted = _F(0), _F(0), _F(0)
        suppression, floor_sum, fill = _F(0), _F(0), _F(0)
        for x in range(width):
            through = _F(1) - alpha[y, x]
            masked = floor_aware and floor[y, x]
            w = _F(0) if masked else _F(inlier[y, x])
            for c in range(3):
                true = _F(image[y, x, c]) * _BYTE
                ground = background[c, y, x]
                drawn = rgb[y, x, c] + through * ground
                predicted[c, y, x] = w * drawn
                target[c, y, x] = w * true
                difference = drawn - true
                total += w * abs(difference)
                squares += w * difference * difference
                if masked:
                    error[c, y, x] = ground - true
                    floor_sum += _F(inlier[y, x]) * np.sqrt((ground - true) * (ground - true) + SMOOTH)
                else:
                    error[c, y, x] = difference
            counted += w
            if masked:
                suppression += alpha[y, x]
            else:
                fill += _F(inlier[y, x]) * through
        sums[0, y], sums[1, y], sums[2, y] = total, squares, counted
        sums[3, y], sums[4, y], sums[5, y] = suppression, floor_sum, fill


@njit(parallel=True, cache=True, fastmath=True)
def _differentiate(
    rgb: Any,
    alpha: Any,
    background: Any,
    image: Any,
    floor: Any,
    inlier: Any,
    floor_aware: Any,
    ssim_gradient: Any,
    weights: Any,
    d_rgb: Any,
    d_alpha: Any,
    d_background: Any,
    d_texture: Any,
) -> None:
    # weights: of L1, SSIM, suppression, floor, fill, each already divided by what its mean counts.
    height, width = alpha.shape
    l1, structure, suppression, floor_weight, fill = weights[0], weights[1], weights[2], weights[3], weights[4]
    for y in prange(height):
        for x in range(width):
            through = _F(1) - alpha[y, x]
            masked = floor_aware and floor[y, x]
            inside = _F(inlier[y, x])
            w = _F(0) if masked else inside
            d_through = _F(0)
            for c in range(3):
                true = _F(image[y, x, c]) * _BYTE
                ground = background[c, y, x]
                difference = rgb[y, x, c] + through * ground - true
                sign = _F(1) if difference > 0 else (_F(-1) if difference < 0 else _F(0))
                d = w * (l1 * sign - structure * ssim_gradient[c, y, x])
                d_rgb[y, x, c] = d
                d_through += d * ground
                painted = _F(0)
                if masked:
                    off = ground - true
                    painted = floor_weight * inside * off / np.sqrt(off * off + SMOOTH)
                d_texture[c, y, x] = painted
                d_background[c, y, x] = painted + through * d
            if masked:
                d_alpha[y, x] = suppression - d_through
            else:
                d_alpha[y, x] = -fill * inside - d_through


@dataclass(frozen=True)
class LossValues:
    """The terms of one view before their weights, and what is reported of it."""

    l1: float
    ssim: float
    """1 - SSIM."""
    suppression: float
    floor: float
    fill: float
    total: float
    """Their weighted sum."""
    mse: float
    """Mean squared error over the pixels that the reconstruction loss counts."""

    @property
    def psnr(self) -> float:
        """Decibels, over the pixels that the reconstruction loss counts."""
        return float(-10 * np.log10(max(self.mse, 1e-10)))


class FloorAwareLoss:
    """The loss at one image size, with its buffers. After a call:

    d_rgb          (H, W, 3) dL / d(colour of the Gaussians)
    d_alpha        (H, W) dL / d(alpha)
    d_background   (3, H, W) dL / d(background), what the network learns from
    d_texture      (3, H, W) the part of it from the background floor loss: the texture learns from floor pixels only,
                   otherwise whatever shines through half-opaque Gaussians is painted onto the floor
    error          (3, H, W) drawn minus true colour of every pixel: of the background where M, of the image elsewhere
    """

    def __init__(self, config: LossConfig, width: int, height: int) -> None:
        self._config = config
        self._floor_aware = config.masks_floor

        def planes(*shape: int) -> Float32:
            return np.zeros((*shape, height, width), np.float32)

        self._predicted, self._target, self._ssim_gradient = planes(3), planes(3), planes(3)
        self._slopes = planes(3, 3)
        self._sums, self._ssim_sums = np.zeros((6, height)), np.zeros((3, height))
        self.d_rgb = np.zeros((height, width, 3), np.float32)
        self.d_alpha, self.error = planes(), planes(3)
        self.d_background, self.d_texture = planes(3), planes(3)

    def __call__(
        self,
        rgb: Float32,
        alpha: Float32,
        background: Float32,
        image: NDArray[np.uint8],
        floor: NDArray[np.bool_],
        inlier: NDArray[np.bool_],
    ) -> LossValues:
        """`rgb` (H, W, 3), `alpha` (H, W), `background` (3, H, W), `image` (H, W, 3), `floor` and `inlier` (H, W)."""
        c = self._config
        pixels = alpha.size
        given = (rgb, alpha, background, image, floor, inlier, self._floor_aware)
        _compose(*given, self._predicted, self._target, self.error, self._sums)
        structure = 1.0
        if c.ssim > 0:
            ssim_forward(self._predicted, self._target, TAPS, self._slopes, self._ssim_sums)
            ssim_backward(self._predicted, self._target, TAPS, self._slopes, self._ssim_gradient)
            structure = 1.0 - float(self._ssim_sums.sum()) / (3 * pixels)
        weights = np.array(
            [
                (1 - c.ssim) / (3 * pixels),
                c.ssim / (3 * pixels),
                c.suppression / pixels,
                c.floor / (3 * pixels),
                c.fill / pixels,
            ],
            np.float32,
        )
        _differentiate(
            *given, self._ssim_gradient, weights, self.d_rgb, self.d_alpha, self.d_background, self.d_texture
        )
        absolute, squares, counted, suppression, floor_sum, fill = self._sums.sum(axis=1)
        l1 = absolute / (3 * pixels)
        terms = [float(t) for t in (l1, structure, suppression / pixels, floor_sum / (3 * pixels), fill / pixels)]
        factors = (1 - c.ssim, c.ssim, c.suppression, c.floor, c.fill)
        total = float(sum(f * t for f, t in zip(factors, terms, strict=True)))
        mse = float(squares / max(3 * counted, 1))
        return LossValues(terms[0], terms[1], terms[2], terms[3], terms[4], total, mse)
