"""The floor texture while it is learned: grids over world x, y in one vector of texels, sampled where a ray meets the
floor, and the scatter of gradients back into them. Where a ray meets the floor and which levels a pixel sees is the
renderer's rule.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.render.floor_texture import distance_to_floor, footprint_of, level_weight
from nvsim.splats.types import FloorTexture

TEXELS = (0.4, 0.1, 0.04, 0.015)
"""Metres, coarse to fine."""
LARGEST = 2600
"""Most texels of a level along one side; a wider area gets larger texels."""

_F = np.float32
_ONE = _F(1)
Float32 = NDArray[np.float32]


@njit(parallel=True, cache=True, fastmath={"contract", "reassoc", "arcp", "nsz"})
def meet_floor(camera: Any, heights: Any, grid: Any, hits: Any) -> None:
    """Where the rays of a view meet the floor, as `FloorSurface.meet` finds it.

    camera        `pack_camera`
    heights, grid the floor surface: (rows, columns), and (3,) origin x, y and spacing
    hits          out (3, H, W): world x, y, and the footprint of the pixel on the floor in metres: the geometric mean
                  of its width and its length; -1 where the ray does not meet the floor
    """
    _, height, width = hits.shape
    for row in prange(height):
        v = (_F(row) + _F(0.5) - camera[15]) / camera[13]
        for column in range(width):
            u = (_F(column) + _F(0.5) - camera[14]) / camera[12]
            forward = _ONE / np.sqrt(u * u + v * v + _ONE)
            dx = (camera[0] * u + camera[1] * v + camera[2]) * forward
            dy = (camera[3] * u + camera[4] * v + camera[5]) * forward
            dz = (camera[6] * u + camera[7] * v + camera[8]) * forward
            distance = distance_to_floor(heights, grid, camera[9], camera[10], camera[11], dx, dy, dz)
            hits[2, row, column] = -_ONE
            if distance > _F(0):
                hits[0, row, column] = camera[9] + distance * dx
                hits[1, row, column] = camera[10] + distance * dy
                hits[2, row, column] = footprint_of(distance, forward, dz, camera[12])


@njit(inline="always")
def _taps(table: Any, bounds: Any, level: Any, x: Any, y: Any) -> Any:
    rows, columns = table[level, 1], table[level, 2]
    c = (x - bounds[0]) / (bounds[2] - bounds[0]) * _F(columns) - _F(0.5)
    r = (y - bounds[1]) / (bounds[3] - bounds[1]) * _F(rows) - _F(0.5)
    c = min(max(c, _F(0)), _F(columns - 1))
    r = min(max(r, _F(0)), _F(rows - 1))
    c0, r0 = np.int64(c), np.int64(r)
    right, up = min(c0 + 1, columns - 1) - c0, (min(r0 + 1, rows - 1) - r0) * columns
    first = table[level, 0] + r0 * columns + c0
    return first, right, up, c - _F(c0), r - _F(r0)


@njit(parallel=True, cache=True, fastmath=True)
def add_texture(hits: Any, table: Any, sizes: Any, bounds: Any, texels: Any, background: Any) -> None:
    """Adds the texture to `background` (3, H, W) where `hits` says so.

    table    (levels, 3) int64: first texel, rows, columns
    sizes    (levels,) texel size, metres
    bounds   (4,) low x, y, high x, y
    texels   (n, 3)
    """
    _, height, width = hits.shape
    for row in prange(height):
        for column in range(width):
            footprint = hits[2, row, column]
            if footprint < _F(0):
                continue
            x, y = hits[0, row, column], hits[1, row, column]
            for level in range(table.shape[0]):
                weight = level_weight(footprint, sizes[level])
                if weight <= _F(0):
                    continue
                at, right, up, fc, fr = _taps(table, bounds, level, x, y)
                for c in range(3):
                    low = texels[at, c] * (_ONE - fc) + texels[at + right, c] * fc
                    high = texels[at + up, c] * (_ONE - fc) + texels[at + up + right, c] * fc
                    background[c, row, column] += weight * (low * (_ONE - fr) + high * fr)


@njit(parallel=True, cache=True, fastmath=True)
def scatter_texture(hits: Any, table: Any, sizes: Any, bounds: Any, values: Any, texels: Any, weights: Any) -> None:
    """The adjoint of `add_texture`: adds `values` (3, H, W) into `texels` (n, 3), and the weight with which each texel
    was touched into `weights` (n,) where that is not empty. A task per level: no two write to the same texel."""
    _, height, width = hits.shape
    for level in prange(table.shape[0]):
        for row in range(height):
            for column in range(width):
                footprint = hits[2, row, column]
                if footprint < _F(0):
                    continue
                v0, v1, v2 = values[0, row, column], values[1, row, column], values[2, row, column]
                if v0 == _F(0) and v1 == _F(0) and v2 == _F(0):
                    continue
                weight = level_weight(footprint, sizes[level])
                if weight <= _F(0):
                    continue
                x, y = hits[0, row, column], hits[1, row, column]
                at, right, up, fc, fr = _taps(table, bounds, level, x, y)
                for corner in range(4):
                    to, share = at, weight
                    if corner & 1:
                        to, share = to + right, share * fc
                    else:
                        share = share * (_ONE - fc)
                    if corner & 2:
                        to, share = to + up, share * fr
                    else:
                        share = share * (_ONE - fr)
                    texels[to, 0] += share * v0
                    texels[to, 1] += share * v1
                    texels[to, 2] += share * v2
                    if weights.size > 0:
                        weights[to] += share


class LearnedTexture:
    """Texels over an area, all zero at first; the optimiser changes `values` (n, 3) in place, from `gradient`."""

    def __init__(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        self._low, self._high = low, high
        self.bounds = np.array([*low, *high], np.float32)
        table, sizes, first = [], [], 0
        for texel in TEXELS:
            columns = int(np.clip(np.ceil((high[0] - low[0]) / texel), 1, LARGEST))
            rows = int(np.clip(np.ceil((high[1] - low[1]) / texel), 1, LARGEST))
            table.append((first, rows, columns))
            sizes.append(max((high[0] - low[0]) / columns, (high[1] - low[1]) / rows))
            first += rows * columns
        self.table, self.sizes = np.array(table, np.int64), np.array(sizes, np.float32)
        self.values = np.zeros((first, 3), np.float32)
        self.gradient = np.zeros_like(self.values)

    def add(self, hits: Float32, background: Float32) -> None:
        """Adds the texture to `background` (3, H, W), `hits` from `meet_floor`."""
        add_texture(hits, self.table, self.sizes, self.bounds, self.values, background)

    def collect(self, hits: Float32, d_background: Float32) -> None:
        """Adds to `gradient` from dL / d(background) (3, H, W)."""
        scatter_texture(hits, self.table, self.sizes, self.bounds, d_background, self.gradient, _UNWEIGHTED)

    def level(self, index: int) -> slice:
        """The texels of one level within `values`."""
        first, rows, columns = self.table[index]
        return slice(int(first), int(first + rows * columns))

    def exported(self) -> FloorTexture:
        """A copy as the renderer takes it."""
        levels = tuple(
            self.values[self.level(i)].reshape(rows, columns, 3).copy()
            for i, (_, rows, columns) in enumerate(self.table)
        )
        return FloorTexture(levels, self._low, self._high)


_UNWEIGHTED = np.empty(0, np.float32)
