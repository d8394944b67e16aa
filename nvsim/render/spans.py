"""Which tiles and rows an ellipse touches, exactly: compiled into projection, binning and both raster passes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from nvsim.render.arithmetic import FLAGS
from nvsim.render.layout import CONIC_A, CONIC_B, CONIC_C, HALF_HEIGHT, HALF_WIDTH, LOG_CUT, LOG_OPACITY, TILE, X, Y

_F = np.float32
_TWO = _F(2)


@njit(forceinline=True, fastmath=FLAGS)
def tile_rows(splat: Any, lines: Any) -> Any:
    """First and past-last of the `lines` rows of tiles with a pixel centre between the ellipse's top and bottom."""
    top = max(splat[Y] - splat[HALF_HEIGHT], _F(0))
    bottom = min(splat[Y] + splat[HALF_HEIGHT], _F(lines * TILE - 1))
    low, high = np.int64(math.ceil(top)), np.int64(math.floor(bottom))
    return low // TILE, high // TILE + 1 if high >= low else low // TILE


@njit(forceinline=True, fastmath=FLAGS)
def tile_columns(splat: Any, line: Any, columns: Any) -> Any:
    """First and past-last of the `columns` tiles in row `line` that the ellipse touches.

    The widest point of an ellipse lies at dy = -B dx / (2 C); inside the row of tiles the extreme is there, otherwise
    on the nearer border of the row.
    """
    a, b, c = -splat[CONIC_A], -splat[CONIC_B], -splat[CONIC_C]
    m = splat[LOG_OPACITY] - LOG_CUT
    top = max(_F(line * TILE) - splat[Y], -splat[HALF_HEIGHT])
    bottom = min(_F(line * TILE + TILE - 1) - splat[Y], splat[HALF_HEIGHT])
    widest = -b * splat[HALF_WIDTH] / (_TWO * c)
    dy = min(max(widest, top), bottom)
    right = (-b * dy + math.sqrt(max(b * b * dy * dy - _F(4) * a * (c * dy * dy - m), _F(0)))) / (_TWO * a)
    dy = min(max(-widest, top), bottom)
    left = (-b * dy - math.sqrt(max(b * b * dy * dy - _F(4) * a * (c * dy * dy - m), _F(0)))) / (_TWO * a)
    low = np.int64(math.ceil(max(splat[X] + left, _F(0))))
    high = np.int64(math.floor(min(splat[X] + right, _F(columns * TILE - 1))))
    return low // TILE, high // TILE + 1 if high >= low else low // TILE


@njit(forceinline=True, fastmath=FLAGS)
def pixel_rows(splat: Any, top: Any) -> Any:
    """First and past-last row, counted from `top`, of a tile's rows that the ellipse touches."""
    y = splat[Y] - _F(top)
    low = np.int64(math.ceil(max(y - splat[HALF_HEIGHT], _F(0))))
    high = np.int64(math.floor(min(y + splat[HALF_HEIGHT], _F(TILE - 1))))
    return low, high + 1
