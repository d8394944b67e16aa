"""Splats to pixels, front to back, tile by tile (Kerbl et al. 2023, section 6): the forward pass.

One row of a tile is 16 floats, so each line of the inner loops is one vector instruction. All planes of a tile are in
one buffer at constant distances. So LLVM knows that they do not overlap, and vectorizes without run-time checks.
"""

from __future__ import annotations

import numpy as np

from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import exp2_below
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
    NORMAL,
    RED,
    T_STOP,
    TILE,
    WIDTH,
    Float32,
    Int32,
    Int64,
    Whole,
    X,
    Y,
)

_F = np.float32
_PLANES = 8  # transmittance, red, green, blue, depth, normal (3)
_CHECK = 8  # splats between two tests of whether the tile is finished
AHEAD = 32  # splats that are fetched together


@njit(forceinline=True, fastmath=True, error_model="numpy")
def _weight(
    dx: np.float32,  # pixels from the center of the splat
    a: np.float32,  # of log2 alpha = constant + linear dx + a dx^2
    linear: np.float32,
    constant: np.float32,
    through: np.float32,  # transmittance before the splat, 0 to 1
) -> np.float32:
    power = max(constant + dx * (linear + a * dx), _F(-100))
    alpha = min(exp2_below(power), ALPHA_MAX)
    return (alpha if power >= LOG_CUT else _F(0)) * through


@njit(forceinline=True, error_model="numpy")
def fetch(
    splats: Float32,  # (N, 16) columns as in render.layout
    rows: Int32,  # (entries or more,) rows of splats
    first: Whole,
    end: Whole,  # past the last
    batch: Float32,  # (AHEAD, 16) out
) -> None:
    """Copies splats[rows[first:end]] to `batch` (AHEAD, 16). They are scattered in memory. Consecutive loads are waited
    for together; a load between two computations would be waited for alone."""
    for k in range(first, end):
        source, target = splats[rows[k]], batch[k - first]
        for i in range(WIDTH):
            target[i] = source[i]


@njit(fastmath=True, error_model="numpy")
def _draw_part(
    thread: int,
    splats: Float32,  # as in `draw`, like all following
    rows: Int32,
    offsets: Int64,
    threads: int,
    geometry: bool,
    rgb: Float32,
    transmittance: Float32,
    depth: Float32,
    normal: Float32,
    last: Int64,
) -> None:
    height, width = transmittance.shape
    columns = (width + TILE - 1) // TILE
    tiles = offsets.shape[0] - 1
    planes = np.empty((TILE, _PLANES * TILE), np.float32)
    batch = np.empty((AHEAD, WIDTH), np.float32)
    for tile in range(thread, tiles, threads):
        left, top = (tile % columns) * TILE, (tile // columns) * TILE
        if offsets[tile] == offsets[tile + 1]:
            last[tile] = offsets[tile]
            right, bottom = min(left + TILE, width), min(top + TILE, height)
            transmittance[top:bottom, left:right] = _F(1)
            rgb[top:bottom, left:right] = _F(0)
            if geometry:
                depth[top:bottom, left:right] = _F(0)
                normal[top:bottom, left:right] = _F(0)
            continue
        for y in range(TILE):
            line = planes[y]
            for i in range(TILE):
                line[i] = _F(1)
            for i in range(TILE, _PLANES * TILE):
                line[i] = _F(0)
        k = begin = offsets[tile]
        end = offsets[tile + 1]
        while k < end:
            if (k - begin) & (AHEAD - 1) == 0:
                fetch(splats, rows, k, min(k + AHEAD, end), batch)
            splat = batch[(k - begin) & (AHEAD - 1)]
            gx, gy = splat[X] - _F(left), splat[Y] - _F(top)
            a, b, c = splat[CONIC_A], splat[CONIC_B], splat[CONIC_C]
            log_opacity = splat[LOG_OPACITY]
            red, green, blue = splat[RED], splat[GREEN], splat[BLUE]
            z, nx, ny, nz = splat[DEPTH], splat[NORMAL], splat[NORMAL + 1], splat[NORMAL + 2]
            low, high = pixel_rows(splat, top)
            for y in range(low, high):
                dy = _F(y) - gy
                constant, linear = log_opacity + c * dy * dy, b * dy
                line = planes[y]
                # Two loops, not one with a second over its weights: LLVM unrolls a short loop before vectorizing it.
                if geometry:
                    for x in range(TILE):
                        weight = _weight(_F(x) - gx, a, linear, constant, line[x])
                        line[x] -= weight
                        line[TILE + x] += weight * red
                        line[2 * TILE + x] += weight * green
                        line[3 * TILE + x] += weight * blue
                        line[4 * TILE + x] += weight * z
                        line[5 * TILE + x] += weight * nx
                        line[6 * TILE + x] += weight * ny
                        line[7 * TILE + x] += weight * nz
                else:
                    for x in range(TILE):
                        weight = _weight(_F(x) - gx, a, linear, constant, line[x])
                        line[x] -= weight
                        line[TILE + x] += weight * red
                        line[2 * TILE + x] += weight * green
                        line[3 * TILE + x] += weight * blue
            k += 1
            # Counted from the tile's own first splat: other tiles must not change where this one stops.
            if (k - begin) & (_CHECK - 1) == 0:
                most = _F(0)
                for y in range(min(TILE, height - top)):
                    line = planes[y]
                    for x in range(TILE):
                        most = max(most, line[x])
                if most < T_STOP:
                    break
        last[tile] = k
        for y in range(min(TILE, height - top)):
            line = planes[y]
            for x in range(min(TILE, width - left)):
                transmittance[top + y, left + x] = line[x]
                for channel in range(3):
                    rgb[top + y, left + x, channel] = line[(1 + channel) * TILE + x]
                if geometry:
                    depth[top + y, left + x] = line[4 * TILE + x]
                    for channel in range(3):
                        normal[top + y, left + x, channel] = line[(5 + channel) * TILE + x]


@njit(parallel=True, cache=True, nogil=True)
def draw(
    splats: Float32,  # (N, 16) of `projection.project`, columns as in render.layout
    rows: Int32,  # (entries or more,) rows of splats, of `tiles.sort`
    offsets: Int64,  # (tiles + 1,) start of each tile in rows, of `tiles.starts`
    threads: int,  # number of tasks that share the tiles
    geometry: bool,  # whether depth and normal are computed
    rgb: Float32,  # (H, W, 3) out: color over black
    transmittance: Float32,  # (H, W) out: 1 - alpha, 0 to 1
    depth: Float32,  # (H, W) out: sum of weight * depth, meters; (0, 0) without geometry
    normal: Float32,  # (H, W, 3) out: sum of weight * normal, world; (0, 0, 3) without geometry
    last: Int64,  # (tiles,) out: past-last entry of rows that the tile drew
) -> None:
    """Draws the splats of every tile, front to back, into rgb (H, W, 3) and the other outputs, until almost no light
    remains. The weight of a splat is its alpha times the transmittance before it."""
    for thread in prange(threads):
        _draw_part(thread, splats, rows, offsets, threads, geometry, rgb, transmittance, depth, normal, last)
