"""Computes exactly which tiles and rows an ellipse touches; compiled into projection, binning, and both raster
passes."""

from __future__ import annotations

import math

import numpy as np

from nvsim.kernels import njit
from nvsim.render.arithmetic import FLAGS
from nvsim.render.kernel_types import (
    CONIC_A,
    CONIC_B,
    CONIC_C,
    HALF_HEIGHT,
    HALF_WIDTH,
    LOG_CUT,
    LOG_OPACITY,
    TILE,
    TILE_BITS,
    Float32,
    Whole,
    X,
    Y,
)

_F = np.float32
_TWO = _F(2)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _floor(x: np.float32) -> np.int64:
    # For x >= -1. The library's floor is a function call, a truncation is one instruction.
    return np.int64(x + _F(1)) - 1


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _ceil(x: np.float32) -> np.int64:
    # For x >= 0.
    whole = np.int64(x)
    return whole + (_F(whole) < x)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def tile_box(
    splat: Float32,  # (16,) as in render.layout
    columns: Whole,  # tiles in a row of the image
    lines: Whole,  # rows of tiles
) -> tuple[np.int64, np.int64, np.int64, np.int64]:
    """First and past-last row of tiles, first and past-last column, with a pixel center within the bounding box of the
    ellipse, among `columns` x `lines` tiles. `splat` is (16,)."""
    left = _ceil(max(splat[X] - splat[HALF_WIDTH], _F(0)))
    right = _floor(max(min(splat[X] + splat[HALF_WIDTH], _F(columns * TILE - 1)), _F(-1)))
    top = _ceil(max(splat[Y] - splat[HALF_HEIGHT], _F(0)))
    bottom = _floor(max(min(splat[Y] + splat[HALF_HEIGHT], _F(lines * TILE - 1)), _F(-1)))
    if right < left or bottom < top:
        return np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    return top >> TILE_BITS, (bottom >> TILE_BITS) + 1, left >> TILE_BITS, (right >> TILE_BITS) + 1


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def tile_columns(
    splat: Float32,  # (16,) as in render.layout
    line: int,  # row of tiles
    left: np.int64,  # columns of tiles, first and past-last, of `tile_box`
    right: np.int64,
) -> tuple[np.int64, np.int64]:
    """First and past-last tile of row `line` that the ellipse touches, among those of its bounding box. `splat` is
    (16,).

    At height dy the boundary of the ellipse a dx^2 + b dx dy + c dy^2 = m is at dx = (-b dy +- sqrt(4 a m - (4 a c -
    b^2) dy^2)) / (2 a). Its widest point is at dy = -b dx / (2 c). If that is inside the row of tiles, it is the
    extreme; otherwise the extreme is on the nearer border of the row.
    """
    a, b, c = -splat[CONIC_A], -splat[CONIC_B], -splat[CONIC_C]
    level, bend = _F(4) * a * (splat[LOG_OPACITY] - LOG_CUT), _F(4) * a * c - b * b
    half = _F(0.5) / a
    top = max(_F(line * TILE) - splat[Y], -splat[HALF_HEIGHT])
    bottom = min(_F(line * TILE + TILE - 1) - splat[Y], splat[HALF_HEIGHT])
    widest = -b * splat[HALF_WIDTH] / (_TWO * c)
    high, low = min(max(widest, top), bottom), min(max(-widest, top), bottom)
    last = splat[X] + (-b * high + math.sqrt(max(level - bend * high * high, _F(0)))) * half
    first = splat[X] + (-b * low - math.sqrt(max(level - bend * low * low, _F(0)))) * half
    left = max(_ceil(max(first, _F(0))) >> TILE_BITS, left)
    right = min((_floor(max(last, _F(-1))) >> TILE_BITS) + 1, right)
    return left, right


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def pixel_rows(
    splat: Float32,  # (16,) as in render.layout
    top: Whole,  # the tile's first row of pixels
) -> tuple[np.int64, np.int64]:
    """First and past-last row of a tile, counted from `top`, that the ellipse of `splat` (16,) touches."""
    y = splat[Y] - _F(top)
    low = _ceil(max(y - splat[HALF_HEIGHT], _F(0)))
    high = _floor(max(min(y + splat[HALF_HEIGHT], _F(TILE - 1)), _F(-1)))
    return low, high + 1
