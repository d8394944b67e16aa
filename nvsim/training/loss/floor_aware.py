"""The floor-aware loss of one view and its gradients by the drawn color, alpha, and background (paper, section III-C).

    I_hat = I_GS + (1 - alpha) * I_BG
    L = (1 - lambda_s) |w (I_hat - I)| + lambda_s (1 - SSIM(w I_hat, w I))
      + lambda_supp |M alpha| + lambda_bg M inlier * smooth(I_BG - I) + lambda_fill (1 - M) (1 - D) inlier (1 - alpha)

M is the floor mask, and D is doubtful floor outside M. The weight w is "inlier and not M", or "inlier" if no term
treats the floor separately. The function smooth(x) = sqrt(x^2 + 1e-4) is used because with plain L1, Adam leaves
colored noise on the floor. Every term is a mean over all pixels of the image (and channels).
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit, prange
from nvsim.training.config import LossConfig
from nvsim.training.loss.ssim import RADIUS, SEGMENT, STRIP, planes, ssim_forward, ssim_gradient, tiles

_F = np.float32
_BYTE = _F(1 / 255)
SMOOTH = _F(1e-4)
# The planes of a segment; the error of the prediction overwrites its color.
_TRUE, _OFF, _GROUND, _THROUGH, _MASKED, _INSIDE, _OUT, _SOLID, _PLANES = 0, 3, 6, 9, 10, 11, 12, 16, 17
# For the backward pass: gradients by the color, by the background, and by alpha.
_ERROR, _BY_COLOR, _BY_GROUND, _BY_ALPHA = 0, 3, 12, 15

Float32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]


@njit(fastmath=True)
def _load(
    transmittance: Float32,  # (H, W)
    background: Float32,  # (3, H, W)
    floor: Mask,  # (H, W)
    doubtful: Mask,  # (H, W)
    inlier: Mask,  # (H, W)
    aware: np.float32,  # 1 if the floor mask is used, else 0
    y: int,
    x0: int,  # first column of the segment
    count: int,  # of pixels, at most SEGMENT
    work: Float32,  # (planes * SEGMENT,) out
) -> None:
    # A segment of a row as planes of 128 values each, which stay in the nearest cache. Each loop here reads few arrays,
    # and computations on the planes read one. Compilers vectorize only such loops.
    for c in range(3):
        for i in range(count):
            work[(_GROUND + c) * SEGMENT + i] = background[c, y, x0 + i]
    for i in range(count):
        work[_THROUGH * SEGMENT + i] = transmittance[y, x0 + i]
    for i in range(count):
        work[_MASKED * SEGMENT + i] = aware * _F(floor[y, x0 + i])
    for i in range(count):
        work[_INSIDE * SEGMENT + i] = _F(inlier[y, x0 + i])
    for i in range(count):
        sure = _F(1) - _F(doubtful[y, x0 + i])
        work[_SOLID * SEGMENT + i] = (_F(1) - work[_MASKED * SEGMENT + i]) * sure * work[_INSIDE * SEGMENT + i]
    for i in range(count, SEGMENT):
        work[_THROUGH * SEGMENT + i] = _F(0)
        work[_MASKED * SEGMENT + i] = _F(0)
        work[_SOLID * SEGMENT + i] = _F(0)
        work[_INSIDE * SEGMENT + i] = _F(0)


@njit(fastmath=True)
def _any_floor(work: Float32) -> np.bool_:
    total = _F(0)
    for i in range(SEGMENT):
        total += work[_MASKED * SEGMENT + i]
    return total > _F(0)


@njit(fastmath=True)
def _load_colors(
    rgb: Float32,  # (H * W * 3,)
    image: Bytes,  # (H * W * 3,)
    first: int,  # pixel
    count: int,  # of pixels, at most SEGMENT
    work: Float32,  # (_PLANES * SEGMENT,) of `_load`, changed
) -> None:
    # The true colors and the errors of `count` pixels. The arrays rgb and image are flat, so that the stride of a pixel
    # is known at compile time.
    drawn, true = rgb[3 * first : 3 * (first + count)], image[3 * first : 3 * (first + count)]
    for i in range(count):
        work[_TRUE * SEGMENT + i] = _F(true[3 * i]) * _BYTE
        work[(_TRUE + 1) * SEGMENT + i] = _F(true[3 * i + 1]) * _BYTE
        work[(_TRUE + 2) * SEGMENT + i] = _F(true[3 * i + 2]) * _BYTE
    for i in range(count):
        work[_OFF * SEGMENT + i] = drawn[3 * i]
        work[(_OFF + 1) * SEGMENT + i] = drawn[3 * i + 1]
        work[(_OFF + 2) * SEGMENT + i] = drawn[3 * i + 2]
    for c in range(3):
        for i in range(SEGMENT):
            color = work[(_OFF + c) * SEGMENT + i] + work[_THROUGH * SEGMENT + i] * work[(_GROUND + c) * SEGMENT + i]
            work[(_OFF + c) * SEGMENT + i] = color - work[(_TRUE + c) * SEGMENT + i]


@njit(parallel=True, cache=True, fastmath=True)
def _compose(
    rgb: Float32,  # (H, W, 3) colors in 0 to 1
    transmittance: Float32,  # (H, W)
    background: Float32,  # (3, H, W) colors in 0 to 1
    image: Bytes,  # (H, W, 3)
    floor: Mask,  # (H, W)
    doubtful: Mask,  # (H, W)
    inlier: Mask,  # (H, W)
    aware: np.float32,  # 1 if the floor mask is used, else 0
    threads: int,
    images: Float32,  # (2, 3, ..) `planes`, out
    lit: Bytes,  # `tiles`, out
    error: Float32,  # (3, H, W) out
    sums: NDArray[np.float64],  # (6, H) out
) -> None:
    # Per row: sum and difference of the weighted prediction and target for the SSIM, the error of every pixel (of the
    # background on masked floor), and the sums of every other term.
    height, width = transmittance.shape
    strips, segments = lit.shape
    flat_rgb, flat_image = rgb.reshape(-1), image.reshape(-1)
    for thread in prange(threads):
        work = np.zeros(_PLANES * SEGMENT, np.float32)
        for strip in range(thread, strips, threads):
            lit[strip] = 0
            for y in range(strip * STRIP, min(height, strip * STRIP + STRIP)):
                sums[:, y] = 0
                for segment in range(segments):
                    x0, at = segment * SEGMENT, (y + RADIUS) * SEGMENT
                    count = min(SEGMENT, width - x0)
                    _load(transmittance, background, floor, doubtful, inlier, aware, y, x0, count, work)
                    _load_colors(flat_rgb, flat_image, y * width + x0, count, work)
                    floor_here = _any_floor(work)
                    total, squares, floor_sum = _F(0), _F(0), _F(0)
                    for c in range(3):
                        to_sum = images[0, c, segment, at : at + SEGMENT]
                        to_difference = images[1, c, segment, at : at + SEGMENT]
                        for i in range(SEGMENT):
                            masked, inside = work[_MASKED * SEGMENT + i], work[_INSIDE * SEGMENT + i]
                            w, difference = inside - masked * inside, work[(_OFF + c) * SEGMENT + i]
                            true = work[(_TRUE + c) * SEGMENT + i]
                            off = work[(_GROUND + c) * SEGMENT + i] - true
                            to_sum[i] = w * (difference + true + true)
                            to_difference[i] = w * difference
                            total += w * abs(difference)
                            squares += w * difference * difference
                            work[(_OUT + c) * SEGMENT + i] = difference + masked * (off - difference)
                        if floor_here:
                            for i in range(SEGMENT):
                                off = work[(_OUT + c) * SEGMENT + i]
                                counts = work[_MASKED * SEGMENT + i] * work[_INSIDE * SEGMENT + i]
                                floor_sum += counts * np.sqrt(off * off + SMOOTH)
                        for i in range(count):
                            error[c, y, x0 + i] = work[(_OUT + c) * SEGMENT + i]
                    counted, suppression, fill = _F(0), _F(0), _F(0)
                    for i in range(SEGMENT):
                        masked, through = work[_MASKED * SEGMENT + i], work[_THROUGH * SEGMENT + i]
                        counted += (_F(1) - masked) * work[_INSIDE * SEGMENT + i]
                        suppression += masked * (_F(1) - through)
                        fill += work[_SOLID * SEGMENT + i] * through
                    if counted > _F(0):
                        lit[strip, segment] = 1
                    sums[0, y], sums[1, y], sums[2, y] = sums[0, y] + total, sums[1, y] + squares, sums[2, y] + counted
                    sums[3, y] += suppression
                    sums[4, y] += floor_sum
                    sums[5, y] += fill


@njit(parallel=True, cache=True, fastmath=True)
def _differentiate(
    transmittance: Float32,  # (H, W)
    background: Float32,  # (3, H, W)
    floor: Mask,  # (H, W)
    doubtful: Mask,  # (H, W)
    inlier: Mask,  # (H, W)
    aware: np.float32,  # 1 if the floor mask is used, else 0
    threads: int,
    images: Float32,  # (2, 3, ..) `planes` of `_compose`
    slopes: Float32,  # (3, 3, ..) `planes` of `ssim_forward`
    lit: Bytes,  # `tiles` of `_compose`
    error: Float32,  # (3, H, W) of `_compose`
    weights: Float32,  # (5,) of L1, SSIM, suppression, floor, fill, each divided by the number of values in its mean
    d_rgb: Float32,  # (H, W, 3) out
    d_alpha: Float32,  # (H, W) out
    d_background: Float32,  # (3, H, W) out
) -> None:
    # A pixel is either reconstructed or floor, and `error` contains the error of that kind, so the colors are not
    # needed here.
    height, width = transmittance.shape
    strips, segments = lit.shape
    l1, structure, suppression, floor_weight, fill = weights[0], weights[1], weights[2], weights[3], weights[4]
    flat_rgb = d_rgb.reshape(-1)
    for thread in prange(threads):
        work = np.zeros(_PLANES * SEGMENT, np.float32)
        lines = np.zeros((3, STRIP, segments * SEGMENT + 2 * RADIUS), np.float32)
        blurred = np.empty((3, SEGMENT), np.float32)
        similar = np.zeros((3, STRIP, segments * SEGMENT), np.float32)
        for strip in range(thread, strips, threads):
            similar[:] = _F(0)
            if structure > _F(0):
                for c in range(3):
                    ssim_gradient(images, slopes, lit, c, strip, height, lines, blurred, similar[c])
            for y in range(strip * STRIP, min(height, strip * STRIP + STRIP)):
                for segment in range(segments):
                    x0 = segment * SEGMENT
                    count = min(SEGMENT, width - x0)
                    _load(transmittance, background, floor, doubtful, inlier, aware, y, x0, count, work)
                    floor_here = _any_floor(work)
                    for c in range(3):
                        for i in range(count):
                            work[(_ERROR + c) * SEGMENT + i] = error[c, y, x0 + i]
                    for i in range(SEGMENT):
                        masked, solid = work[_MASKED * SEGMENT + i], work[_SOLID * SEGMENT + i]
                        work[_BY_ALPHA * SEGMENT + i] = masked * suppression - solid * fill
                    for c in range(3):
                        alike = similar[c, y - strip * STRIP, x0 : x0 + SEGMENT]
                        for i in range(SEGMENT):
                            masked, inside = work[_MASKED * SEGMENT + i], work[_INSIDE * SEGMENT + i]
                            off = work[(_ERROR + c) * SEGMENT + i]
                            sign = _F(1) if off > 0 else (_F(-1) if off < 0 else _F(0))
                            d = (inside - masked * inside) * (l1 * sign - structure * alike[i])
                            work[(_BY_COLOR + c) * SEGMENT + i] = d
                            work[_BY_ALPHA * SEGMENT + i] -= d * work[(_GROUND + c) * SEGMENT + i]
                            work[(_BY_GROUND + c) * SEGMENT + i] = work[_THROUGH * SEGMENT + i] * d
                        if floor_here:
                            for i in range(SEGMENT):
                                counted = work[_MASKED * SEGMENT + i] * work[_INSIDE * SEGMENT + i]
                                off = work[(_ERROR + c) * SEGMENT + i]
                                painted = counted * floor_weight * off / np.sqrt(off * off + SMOOTH)
                                work[(_BY_GROUND + c) * SEGMENT + i] += painted
                    for c in range(3):
                        for i in range(count):
                            d_background[c, y, x0 + i] = work[(_BY_GROUND + c) * SEGMENT + i]
                    at = 3 * (y * width + x0)
                    to = flat_rgb[at : at + 3 * count]
                    for i in range(count):
                        to[3 * i] = work[_BY_COLOR * SEGMENT + i]
                        to[3 * i + 1] = work[(_BY_COLOR + 1) * SEGMENT + i]
                        to[3 * i + 2] = work[(_BY_COLOR + 2) * SEGMENT + i]
                    for i in range(count):
                        d_alpha[y, x0 + i] = work[_BY_ALPHA * SEGMENT + i]


@dataclass(frozen=True)
class LossValues:
    """The unweighted terms of one view, and the reported figures."""

    l1: float
    ssim: float
    """1 - SSIM."""
    suppression: float
    floor: float
    fill: float
    total: float
    """The weighted sum of the terms."""
    mse: float
    """Mean squared error over the pixels of the reconstruction loss."""

    @property
    def psnr(self) -> float:
        """Decibels, over the pixels of the reconstruction loss."""
        return float(-10 * np.log10(max(self.mse, 1e-10)))


class FloorAwareLoss:
    """The loss for one image size, with its buffers. After a call:

    d_rgb          (H, W, 3) dL / d(color of the Gaussians)
    d_alpha        (H, W) dL / d(alpha)
    d_background   (3, H, W) dL / d(background); on M, only that of the background floor loss
    error          (3, H, W) drawn minus true color of every pixel: of the background on M, of the image elsewhere
    """

    def __init__(self, config: LossConfig, width: int, height: int) -> None:
        self._config = config
        self._aware = np.float32(config.masks_floor)
        self._images, self._slopes = planes(2, height, width), planes(3, height, width)
        self._lit, self._sure = np.zeros(tiles(height, width), np.uint8), np.zeros((height, width), np.bool_)
        self._sums, self._ssim_sums = np.zeros((6, height)), np.zeros((3, len(self._lit)))
        self.d_rgb, self.d_alpha = np.zeros((height, width, 3), np.float32), np.zeros((height, width), np.float32)
        self.d_background, self.error = np.zeros((2, 3, height, width), np.float32)

    def __call__(
        self,
        rgb: Float32,
        transmittance: Float32,
        background: Float32,
        image: NDArray[np.uint8],
        floor: NDArray[np.bool_],
        inlier: NDArray[np.bool_],
        doubtful: NDArray[np.bool_] | None = None,
    ) -> LossValues:
        """Computes the loss and the gradients.

        rgb            (H, W, 3) color of the Gaussians, 0 to 1
        transmittance  (H, W) 1 - alpha
        background     (3, H, W) colors, 0 to 1
        image          (H, W, 3) uint8
        floor, inlier  (H, W) bool
        doubtful       (H, W) bool, D above; None if there is no doubt
        """
        c, threads = self._config, numba.get_num_threads()
        pixels = transmittance.size
        unsure: Mask = self._sure if doubtful is None else doubtful
        aware = self._aware
        colors = np.ascontiguousarray(rgb), transmittance, background, np.ascontiguousarray(image)
        _compose(*colors, floor, unsure, inlier, aware, threads, self._images, self._lit, self.error, self._sums)
        structure = 1.0
        if c.ssim > 0:
            height, width = transmittance.shape
            ssim_forward(self._images, self._lit, height, width, threads, self._slopes, self._ssim_sums)
            structure = 1.0 - float(self._ssim_sums.sum()) / (3 * pixels)
        shares = (1 / (3 * pixels), 1 / (3 * pixels), 1 / pixels, 1 / (3 * pixels), 1 / pixels)
        factors = (1 - c.ssim, c.ssim, c.suppression, c.floor, c.fill)
        weights = np.array([f * s for f, s in zip(factors, shares, strict=True)], np.float32)
        gradients = (self.d_rgb, self.d_alpha, self.d_background)
        known = (self._images, self._slopes, self._lit, self.error)
        _differentiate(transmittance, background, floor, unsure, inlier, aware, threads, *known, weights, *gradients)
        absolute, squares, counted, suppression, floor_sum, fill = self._sums.sum(axis=1).tolist()
        terms = (absolute * shares[0], structure, suppression / pixels, floor_sum * shares[3], fill / pixels)
        total = float(sum(f * t for f, t in zip(factors, terms, strict=True)))
        return LossValues(*terms, total, squares / max(3 * counted, 1))
