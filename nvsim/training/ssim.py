"""SSIM and its gradient in two sweeps over the image (Wang et al. 2004; 11 taps, sigma 1.5, zeros outside).

The blur is symmetric, hence its own adjoint: the gradient blurs the derivatives with respect to the blurred moments.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

_F = np.float32
RADIUS = 5
_TAPS = np.exp(-((np.arange(2 * RADIUS + 1) - RADIUS) ** 2) / (2 * 1.5**2))
TAPS = (_TAPS / _TAPS.sum()).astype(np.float32)
"""(11,) the window along one axis."""
C1, C2 = _F(0.01**2), _F(0.03**2)
_ONE, _TWO = _F(1), _F(2)
STRIP = 8
"""Rows of a channel that one task takes."""


@njit(parallel=True, cache=True, fastmath=True)
def ssim_forward(a: Any, b: Any, taps: Any, slopes: Any, sums: Any) -> None:
    """SSIM of two planar images and its derivatives by the blurred moments of the first.

    a, b     (C, H, W) float32
    taps     TAPS
    slopes   out (3, C, H, W): by mean(a), mean(a^2), mean(a b)
    sums     out (C, H) float64, the sum of SSIM along each row
    """
    channels, height, width = a.shape
    strips = (height + STRIP - 1) // STRIP
    for task in prange(channels * strips):
        channel, strip = task // strips, task % strips
        column = np.zeros((5, width + 2 * RADIUS), np.float32)
        blurred = np.empty((5, width), np.float32)
        for y in range(strip * STRIP, min(height, strip * STRIP + STRIP)):
            column[:] = _F(0)
            c0, c1, c2, c3, c4 = column[0], column[1], column[2], column[3], column[4]
            for j in range(2 * RADIUS + 1):
                yy = y + j - RADIUS
                if yy < 0 or yy >= height:
                    continue
                ra, rb, t = a[channel, yy], b[channel, yy], taps[j]
                for x in range(width):
                    va, vb = ra[x], rb[x]
                    ta, tb = t * va, t * vb
                    c0[x + RADIUS] += ta
                    c1[x + RADIUS] += tb
                    c2[x + RADIUS] += ta * va
                    c3[x + RADIUS] += tb * vb
                    c4[x + RADIUS] += ta * vb
            blurred[:] = _F(0)
            for k in range(5):
                source, target = column[k], blurred[k]
                for j in range(2 * RADIUS + 1):
                    t = taps[j]
                    for x in range(width):
                        target[x] += t * source[x + j]
            m0, m1, m2, m3, m4 = blurred[0], blurred[1], blurred[2], blurred[3], blurred[4]
            s0, s1, s2 = slopes[0, channel, y], slopes[1, channel, y], slopes[2, channel, y]
            total = _F(0)
            for x in range(width):
                ma, mb = m0[x], m1[x]
                n1 = _TWO * ma * mb + C1
                n2 = _TWO * (m4[x] - ma * mb) + C2
                d1 = _ONE / (ma * ma + mb * mb + C1)
                d2 = _ONE / (m2[x] - ma * ma + m3[x] - mb * mb + C2)
                value = n1 * n2 * d1 * d2
                total += value
                s0[x] = _TWO * (mb * (n2 - n1) * d1 * d2 + ma * value * (d2 - d1))
                s1[x] = -value * d2
                s2[x] = _TWO * n1 * d1 * d2
            sums[channel, y] = total


@njit(parallel=True, cache=True, fastmath=True)
def ssim_backward(a: Any, b: Any, taps: Any, slopes: Any, gradient: Any) -> None:
    """d(sum of SSIM) / da, from the `slopes` of `ssim_forward`, into `gradient` (C, H, W)."""
    channels, height, width = a.shape
    strips = (height + STRIP - 1) // STRIP
    for task in prange(channels * strips):
        channel, strip = task // strips, task % strips
        column = np.zeros((3, width + 2 * RADIUS), np.float32)
        blurred = np.empty((3, width), np.float32)
        for y in range(strip * STRIP, min(height, strip * STRIP + STRIP)):
            column[:] = _F(0)
            c0, c1, c2 = column[0], column[1], column[2]
            for j in range(2 * RADIUS + 1):
                yy = y + j - RADIUS
                if yy < 0 or yy >= height:
                    continue
                s0, s1, s2, t = slopes[0, channel, yy], slopes[1, channel, yy], slopes[2, channel, yy], taps[j]
                for x in range(width):
                    c0[x + RADIUS] += t * s0[x]
                    c1[x + RADIUS] += t * s1[x]
                    c2[x + RADIUS] += t * s2[x]
            blurred[:] = _F(0)
            for k in range(3):
                source, target = column[k], blurred[k]
                for j in range(2 * RADIUS + 1):
                    t = taps[j]
                    for x in range(width):
                        target[x] += t * source[x + j]
            m0, m1, m2 = blurred[0], blurred[1], blurred[2]
            ra, rb, out = a[channel, y], b[channel, y], gradient[channel, y]
            for x in range(width):
                out[x] = m0[x] + _TWO * ra[x] * m1[x] + rb[x] * m2[x]
