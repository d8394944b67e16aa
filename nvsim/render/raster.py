"""Splats to pixels, front to back, tile by tile (Kerbl et al. 2023, section 6), forward.

One row of a tile is 16 floats, so each line of the inner loops is one vector instruction. All planes of a tile lie in
one buffer at constant distances: so LLVM sees that they do not overlap, and vectorises without run-time checks.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange

from nvsim.render.arithmetic import exp2_below
from nvsim.render.ellipse_extent import pixel_rows
from nvsim.render.layout import (
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
    X,
    Y,
)

_F = np.float32
_PLANES = 8  # transmittance, red, green, blue, depth, normal (3)
_CHECK = 8  # splats between two looks at whether the tile is finished
AHEAD = 32  # splats that are fetched together


@njit(forceinline=True, fastmath=True, error_model="numpy")
def _weight(dx: Any, a: Any, linear: Any, constant: Any, through: Any) -> Any:
    power = max(constant + dx * (linear + a * dx), _F(-100))
    alpha = min(exp2_below(power), ALPHA_MAX)
    return (alpha if power >= LOG_CUT else _F(0)) * through


@njit(forceinline=True, error_model="numpy")
def fetch(splats: Any, rows: Any, first: Any, end: Any, batch: Any) -> None:
    """Copies splats[rows[first:end]] to `batch`. They lie anywhere in memory; loads that follow each other at once wait
    for it together, where one between two computations would be waited for alone."""
    for k in range(first, end):
        source, target = splats[rows[k]], batch[k - first]
        for i in range(WIDTH):
            target[i] = source[i]


@njit(fastmath=True, error_model="numpy")
def _draw_part(
    thread: Any,
    splats: Any,
    rows: Any,
    offsets: Any,
    threads: Any,
    geometry: Any,
    rgb: Any,
    transmittance: Any,
    depth: Any,
    normal: Any,
    last: Any,
) -> None:
    height, width = transmittance.shape
    columns = (width + TILE - 1) // TILE
    tiles = offsets.shape[0] - 1
    planes = np.empty((TILE, _PLANES * TILE), np.float32)
    batch = np.empty((AHEAD, WIDTH), np.float32)
    for tile in range(thread, tiles, threads):
        left, top = (tile % columns) * TILE, (tile // columns) * TILE
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
                # Two loops, not one and a second over its weights: LLVM unrolls a short loop before it vectorises it.
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
            # Counted from the tile's own first splat: what other tiles draw must not change where this one stops.
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
    splats: Any,
    rows: Any,
    offsets: Any,
    threads: Any,
    geometry: Any,
    rgb: Any,
    transmittance: Any,
    depth: Any,
    normal: Any,
    last: Any,
) -> None:
    """splats, rows, offsets   from projection and tiles
    geometry        whether `depth` (sum of weight * depth) and `normal` are wanted
    rgb             out (H, W, 3); transmittance out (H, W); depth out (H, W); normal out (H, W, 3)
    last            out (tiles,) int64: past-last entry of `rows` that the tile drew
    """
    for thread in prange(threads):
        _draw_part(thread, splats, rows, offsets, threads, geometry, rgb, transmittance, depth, normal, last)
