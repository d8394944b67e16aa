"""SSIM and its gradient in two sweeps over the image (Wang et al. 2004; 11 taps, sigma 1.5, zeros outside).

The formulas use the sum s = a + b and the difference d = a - b of the two images instead of the images themselves. With
S = blur(s), D = blur(d), V = blur(s^2) - S^2 and W = blur(d^2) - D^2, where blur is the Gaussian window,

    2 mean_a mean_b = (S^2 - D^2) / 2,   mean_a^2 + mean_b^2 = (S^2 + D^2) / 2,   and so V and W for the covariances:

This needs four blurs instead of five. Rounding errors of bright flat areas cancel, because both images share V. The
blur is symmetric, so it is its own adjoint: the gradient blurs the derivatives with respect to the blurred moments.

Images are divided into tiles of STRIP rows and SEGMENT columns. Tiles are skipped if both images are black in and
around them (under the floor mask). A plane is stored segment by segment, so that the stride between rows is known at
compile time. Only then do compilers see that eleven rows are one array, and vectorize.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit, prange

_F = np.float32
RADIUS = 5
WINDOW = 2 * RADIUS + 1
_TAPS = np.exp(-((np.arange(WINDOW) - RADIUS) ** 2) / (2 * 1.5**2))
TAPS = (_TAPS / _TAPS.sum()).astype(np.float32)
"""(11,) the window along one axis."""
_T0, _T1, _T2, _T3, _T4, _T5 = TAPS[5], TAPS[4], TAPS[3], TAPS[2], TAPS[1], TAPS[0]
C1, C2 = _F(0.01**2), _F(0.03**2)
_ONE, _TWO, _HALF = _F(1), _F(2), _F(0.5)
STRIP, SEGMENT = 8, 128
Float32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]


def planes(count: int, height: int, width: int) -> Float32:
    """(count, 3, segments, (H + 10) * 128) zeros: planes stored by segments, each with the rows above and below the
    image that the window needs. Pixel (y, x) is at [x // 128, (y + 5) * 128 + x % 128]."""
    return np.zeros((count, 3, tiles(height, width)[1], (height + 2 * RADIUS) * SEGMENT), np.float32)


def tiles(height: int, width: int) -> tuple[int, int]:
    """The numbers of rows and columns of tiles that cover an image."""
    return -(-height // STRIP), -(-width // SEGMENT)


@njit(inline="always")
def _is_near(lit: Bytes, strip: int, segment: int) -> bool:
    # Whether an image is lit in a tile or in those above and below.
    return lit[strip, segment] | lit[max(strip - 1, 0), segment] | lit[min(strip + 1, lit.shape[0] - 1), segment] != 0


@njit(inline="always")
def is_lit_near_tile(
    lit: Bytes,  # `tiles`, 0 where both images are black
    strip: int,  # row of the tile
    segment: int,  # column of the tile
) -> bool:
    """Whether an image is lit in a tile or in the pixels around it that its window covers. `lit` is (rows, columns)."""
    last = lit.shape[1] - 1
    return (
        _is_near(lit, strip, segment)
        or _is_near(lit, strip, max(segment - 1, 0))
        or _is_near(lit, strip, min(segment + 1, last))
    )


@njit(fastmath=True)
def _blur_columns(
    plane: Float32,  # ((H + 10) * 128,) a segment of `planes`
    y: int,  # row of the image
    out: Float32,  # (128,)
) -> None:
    # Blurs a segment along its columns, around row y of the image. All eleven taps at once: sums stay in registers.
    p = plane[y * SEGMENT : (y + WINDOW) * SEGMENT]
    for x in range(SEGMENT):
        out[x] = (
            _T0 * p[x + 5 * SEGMENT]
            + _T1 * (p[x + 4 * SEGMENT] + p[x + 6 * SEGMENT])
            + _T2 * (p[x + 3 * SEGMENT] + p[x + 7 * SEGMENT])
            + _T3 * (p[x + 2 * SEGMENT] + p[x + 8 * SEGMENT])
            + _T4 * (p[x + SEGMENT] + p[x + 9 * SEGMENT])
            + _T5 * (p[x] + p[x + 10 * SEGMENT])
        )


@njit(fastmath=True)
def _down_squared(
    plane: Float32,  # ((H + 10) * 128,) a segment of `planes`
    y: int,  # row of the image
    out: Float32,  # (128,)
    squares: Float32,  # (128,) out
) -> None:
    # Blurs the values and their squares as `_blur_columns` does.
    p = plane[y * SEGMENT : (y + WINDOW) * SEGMENT]
    for x in range(SEGMENT):
        a, b, c, d = p[x], p[x + SEGMENT], p[x + 2 * SEGMENT], p[x + 3 * SEGMENT]
        e, f, g = p[x + 4 * SEGMENT], p[x + 5 * SEGMENT], p[x + 6 * SEGMENT]
        h, i, j, k = p[x + 7 * SEGMENT], p[x + 8 * SEGMENT], p[x + 9 * SEGMENT], p[x + 10 * SEGMENT]
        out[x] = _T0 * f + _T1 * (e + g) + _T2 * (d + h) + _T3 * (c + i) + _T4 * (b + j) + _T5 * (a + k)
        squares[x] = (
            _T0 * (f * f)
            + _T1 * (e * e + g * g)
            + _T2 * (d * d + h * h)
            + _T3 * (c * c + i * i)
            + _T4 * (b * b + j * j)
            + _T5 * (a * a + k * k)
        )


@njit(fastmath=True)
def _blur_row(
    line: Float32,  # (138,)
    out: Float32,  # (128,)
) -> None:
    # Blurs along the row: line[i + 5] is the pixel of out[i].
    for i in range(SEGMENT):
        out[i] = (
            _T0 * line[i + 5]
            + _T1 * (line[i + 4] + line[i + 6])
            + _T2 * (line[i + 3] + line[i + 7])
            + _T3 * (line[i + 2] + line[i + 8])
            + _T4 * (line[i + 1] + line[i + 9])
            + _T5 * (line[i] + line[i + 10])
        )


@njit(fastmath=True, error_model="numpy")
def _compare(
    blurred: Float32,  # (4, 128) S, D, blur(s^2) and blur(d^2)
    count: int,  # of pixels, at most 128
    by_mean: Float32,  # (128,) out, as the next two
    by_sum: Float32,
    by_difference: Float32,
) -> np.float32:
    # The sum of SSIM over the pixels of a line, and its derivatives by the blurred moments.
    total = _F(0)
    s, d, ss, dd = blurred[0], blurred[1], blurred[2], blurred[3]
    for i in range(count):
        big, small = s[i] * s[i], d[i] * d[i]
        v, w = ss[i] - big, dd[i] - small
        n1, d1 = _HALF * (big - small) + C1, _HALF * (big + small) + C1
        n2, d2 = _HALF * (v - w) + C2, _HALF * (v + w) + C2
        inverse = _ONE / (d1 * d2)
        i1, i2 = inverse * d2, inverse * d1
        value = n1 * n2 * inverse
        total += value
        ratio, rest = n1 * i1, n2 * inverse
        ps, pd = _HALF * i2 * (ratio - value), -_HALF * i2 * (ratio + value)
        by_sum[i], by_difference[i] = ps, pd
        by_mean[i] = s[i] * (rest - value * i1 - _TWO * ps) - d[i] * (rest + value * i1 + _TWO * pd)
    return total


@njit(parallel=True, cache=True, fastmath=True)
def ssim_forward(
    images: Float32,  # (2, 3, ..) `planes`: a + b and a - b of colors in 0 to 1
    lit: Bytes,  # `tiles`, 0 where both images are black
    height: int,  # of the images, pixels
    width: int,  # pixels
    threads: int,  # tasks that share the strips
    slopes: Float32,  # (3, 3, ..) `planes`, out: by the means of a, by blur(s^2), by blur(d^2)
    sums: NDArray[np.float64],  # (3, rows of tiles) out: the sums of SSIM over the pixels
) -> None:
    """SSIM of two planar images (2, 3, ..), and its derivatives (3, 3, ..) by their blurred moments. Derivatives are
    not written in tiles with black surroundings."""
    strips, segments = lit.shape
    for thread in prange(threads):
        lines = np.zeros((4, STRIP, segments * SEGMENT + 2 * RADIUS), np.float32)
        blurred = np.empty((4, SEGMENT), np.float32)
        for task in range(thread, 3 * strips, threads):
            # The floor is at the bottom, so neighboring strips go to different threads.
            channel, strip = task % 3, task // 3
            y0, y1 = strip * STRIP, min(height, strip * STRIP + STRIP)
            for segment in range(segments):
                at = segment * SEGMENT + RADIUS
                near = _is_near(lit, strip, segment)
                # All rows of a tile before the next tile: its eighteen rows fit into the nearest cache.
                for k in range(2):
                    for y in range(y0, y1):
                        to, to_squares = lines[k, y - y0, at : at + SEGMENT], lines[2 + k, y - y0, at : at + SEGMENT]
                        if near:
                            _down_squared(images[k, channel, segment], y, to, to_squares)
                        else:
                            to[:] = _F(0)
                            to_squares[:] = _F(0)
            total = _F(0)
            for segment in range(segments):
                x0, count = segment * SEGMENT, min(SEGMENT, width - segment * SEGMENT)
                if not is_lit_near_tile(lit, strip, segment):
                    total += _F(count * (y1 - y0))
                    continue
                for y in range(y0, y1):
                    for k in range(4):
                        _blur_row(lines[k, y - y0, x0 : x0 + SEGMENT + 2 * RADIUS], blurred[k])
                    at = (y + RADIUS) * SEGMENT
                    total += _compare(
                        blurred,
                        count,
                        slopes[0, channel, segment, at : at + SEGMENT],
                        slopes[1, channel, segment, at : at + SEGMENT],
                        slopes[2, channel, segment, at : at + SEGMENT],
                    )
            sums[channel, strip] = total


@njit(fastmath=True)
def ssim_gradient(
    images: Float32,  # (2, 3, ..) `planes`, as `ssim_forward` took them
    slopes: Float32,  # (3, 3, ..) `planes`, as `ssim_forward` wrote them
    lit: Bytes,  # `tiles`, 0 where both images are black
    channel: int,
    strip: int,  # row of tiles
    height: int,  # of the images, pixels
    lines: Float32,  # (3, 8, segments * 128 + 10) scratch, zero at both ends
    blurred: Float32,  # (3, 128) scratch
    out: Float32,  # (8, segments * 128)
) -> None:
    """Writes d(sum of SSIM) / da of a strip of rows, in its lit tiles, to `out` (8, segments * 128)."""
    segments = lit.shape[1]
    y0, y1 = strip * STRIP, min(height, strip * STRIP + STRIP)
    for segment in range(segments):
        if is_lit_near_tile(lit, strip, segment):
            at = segment * SEGMENT + RADIUS
            for k in range(3):
                for y in range(y0, y1):
                    _blur_columns(slopes[k, channel, segment], y, lines[k, y - y0, at : at + SEGMENT])
    for segment in range(segments):
        if lit[strip, segment] != 0:
            x0 = segment * SEGMENT
            for y in range(y0, y1):
                for k in range(3):
                    _blur_row(lines[k, y - y0, x0 : x0 + SEGMENT + 2 * RADIUS], blurred[k])
                at = (y + RADIUS) * SEGMENT
                s, d = images[0, channel, segment, at : at + SEGMENT], images[1, channel, segment, at : at + SEGMENT]
                m0, m1, m2, to = blurred[0], blurred[1], blurred[2], out[y - y0, x0 : x0 + SEGMENT]
                for i in range(SEGMENT):
                    to[i] = m0[i] + _TWO * (s[i] * m1[i] + d[i] * m2[i])
