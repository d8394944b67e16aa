"""Pixels to splats: gradients of the color, depth, center, conic, and opacity of every splat.

Tiles are processed back to front; the transmittance before a splat is recovered by a division by 1 - alpha. The
gradients of pixels are first summed per column of the tile, because dx is constant there, so nine sums suffice.
"""

from __future__ import annotations

import numpy as np

from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import LN2, exp2_below
from nvsim.render.ellipse_extent import pixel_rows
from nvsim.render.kernel_types import (
    ALPHA_MAX,
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    DEPTH,
    GREEN,
    LOG_CUT,
    LOG_OPACITY,
    OPACITY,
    RED,
    TILE,
    WIDTH,
    Float32,
    Int32,
    Int64,
    Whole,
    X,
    Y,
)
from nvsim.render.raster import AHEAD, fetch

_F = np.float32
_HALF, _ONE, _TWO = _F(0.5), _F(1), _F(2)
_PLANES = 6  # transmittance, light from behind, gradients of red, green, blue, depth
_SUMS = 9

GRADIENT_WIDTH = 12
"""Number of columns: red, green, blue, depth, x, y, conic a, b, c (natural units), opacity, and the sums over pixels of
the absolute values of the x and y gradients."""


@njit(forceinline=True, error_model="numpy")
def _add(
    found: Float32,  # (AHEAD, 12) gradients of the splats rows[first:end]
    rows: Int32,
    first: Whole,
    end: Whole,
    out: Float32,  # (N or more, 12) changed
) -> None:
    # As in `fetch`, scattered rows are waited for together.
    for k in range(first, end):
        source, target = found[k - first], out[rows[k]]
        for i in range(GRADIENT_WIDTH):
            target[i] += source[i]


@njit(fastmath=True, error_model="numpy")
def _draw_gradient_part(
    thread: int,
    splats: Float32,  # as in `draw_gradient`, like all following
    rows: Int32,
    offsets: Int64,
    last: Int64,
    visible: Int32,
    threads: int,
    transmittance: Float32,
    d_rgb: Float32,
    d_alpha: Float32,
    d_depth: Float32,
    gradients: Float32,
) -> None:
    height, width = transmittance.shape
    columns = (width + TILE - 1) // TILE
    tiles = offsets.shape[0] - 1
    out = gradients[thread]
    blocks = visible.shape[0]
    for block in range(blocks):
        first = splats.shape[0] * block // blocks
        out[first : first + visible[block]] = _F(0)
    planes = np.empty((TILE, _PLANES * TILE), np.float32)
    sums = np.empty(_SUMS * TILE, np.float32)
    batch, found = np.empty((AHEAD, WIDTH), np.float32), np.empty((AHEAD, GRADIENT_WIDTH), np.float32)
    for tile in range(thread, tiles, threads):
        left, top = (tile % columns) * TILE, (tile // columns) * TILE
        planes[:] = _F(0)
        for y in range(min(TILE, height - top)):
            line = planes[y]
            for x in range(min(TILE, width - left)):
                t = transmittance[top + y, left + x]
                line[x] = t
                line[TILE + x] = -d_alpha[top + y, left + x] * t
                for channel in range(3):
                    line[(2 + channel) * TILE + x] = d_rgb[top + y, left + x, channel]
                line[5 * TILE + x] = d_depth[top + y, left + x]
        begin, end = offsets[tile], last[tile]
        for k in range(end - 1, begin - 1, -1):
            at = (k - begin) & (AHEAD - 1)
            if k == end - 1 or at == AHEAD - 1:
                fetch(splats, rows, k - at, k + 1, batch)
            splat = batch[at]
            gx, gy = splat[X] - _F(left), splat[Y] - _F(top)
            a, b, c = splat[CONIC_A], splat[CONIC_B], splat[CONIC_C]
            log_opacity = splat[LOG_OPACITY]
            red, green, blue, z = splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH]
            for i in range(_SUMS * TILE):
                sums[i] = _F(0)
            low, high = pixel_rows(splat, top)
            for y in range(low, high):
                dy = _F(y) - gy
                constant, linear = log_opacity + c * dy * dy, b * dy
                slope_y = _TWO * c * dy
                line = planes[y]
                for x in range(TILE):
                    dx = _F(x) - gx
                    power = max(constant + dx * (linear + a * dx), _F(-100))
                    free = exp2_below(power)
                    alpha = min(free, ALPHA_MAX)
                    alpha = alpha if power >= LOG_CUT else _F(0)
                    inverse = _ONE / (_ONE - alpha)
                    before = line[x] * inverse
                    line[x] = before
                    weight = alpha * before
                    dr, dg, db, dd = line[2 * TILE + x], line[3 * TILE + x], line[4 * TILE + x], line[5 * TILE + x]
                    own = dr * red + dg * green + db * blue + dd * z
                    d_power = alpha * (before * own - line[TILE + x] * inverse)
                    d_power = d_power if free < ALPHA_MAX else _F(0)
                    line[TILE + x] += weight * own
                    sums[x] += weight * dr
                    sums[TILE + x] += weight * dg
                    sums[2 * TILE + x] += weight * db
                    sums[3 * TILE + x] += weight * dd
                    sums[4 * TILE + x] += d_power
                    sums[5 * TILE + x] += d_power * dy
                    sums[6 * TILE + x] += d_power * dy * dy
                    sums[7 * TILE + x] += abs(d_power * (_TWO * a * dx + linear))
                    sums[8 * TILE + x] += abs(d_power * (slope_y + b * dx))
            g_red = g_green = g_blue = g_depth = _F(0)
            p = px = pxx = py = pxy = pyy = abs_x = abs_y = _F(0)
            for x in range(TILE):
                dx = _F(x) - gx
                g_red += sums[x]
                g_green += sums[TILE + x]
                g_blue += sums[2 * TILE + x]
                g_depth += sums[3 * TILE + x]
                p += sums[4 * TILE + x]
                px += sums[4 * TILE + x] * dx
                pxx += sums[4 * TILE + x] * dx * dx
                py += sums[5 * TILE + x]
                pxy += sums[5 * TILE + x] * dx
                pyy += sums[6 * TILE + x]
                abs_x += sums[7 * TILE + x]
                abs_y += sums[8 * TILE + x]
            row = found[at]
            row[0], row[1], row[2], row[3] = g_red, g_green, g_blue, g_depth
            row[4] = -LN2 * (_TWO * a * px + b * py)
            row[5] = -LN2 * (_TWO * c * py + b * px)
            row[6], row[7], row[8] = -_HALF * pxx, -pxy, -_HALF * pyy
            row[9] = p / splat[OPACITY]
            row[10], row[11] = LN2 * abs_x, LN2 * abs_y
            if at == 0:
                _add(found, rows, k, min(k + AHEAD, end), out)


@njit(parallel=True, cache=True, nogil=True)
def draw_gradient(
    splats: Float32,  # (N, 16) columns as in render.layout
    rows: Int32,  # (entries or more,) rows of splats, of `tiles.sort`
    offsets: Int64,  # (tiles + 1,) start of each tile in rows
    last: Int64,  # (tiles,) past-last entry of rows that `raster.draw` drew
    visible: Int32,  # (blocks,) rows of each block of splats, of `projection.project`
    threads: int,  # number of tasks that share the tiles
    transmittance: Float32,  # (H, W) as written by `raster.draw`
    d_rgb: Float32,  # (H, W, 3) gradient by the color
    d_alpha: Float32,  # (H, W) by alpha = 1 - transmittance
    d_depth: Float32,  # (H, W) by the sum of weight * depth, per meter
    gradients: Float32,  # (threads, N or more, GRADIENT_WIDTH) out: each thread's part of the sum
) -> None:
    """Gradients of the splats from those of the images of `raster.draw`. `gradients` (threads, N or more,
    GRADIENT_WIDTH) must be summed over its first axis; only the rows that `visible` counts are written."""
    for thread in prange(threads):
        _draw_gradient_part(
            thread, splats, rows, offsets, last, visible, threads, transmittance, d_rgb, d_alpha, d_depth, gradients
        )
