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

DARK = np.float32(1 / 1024)
"""Light that cannot be seen in 8 bits."""
_F = np.float32
_ONE = _F(1)
Float32 = NDArray[np.float32]


@njit(parallel=True, cache=True, fastmath={"contract", "reassoc", "arcp", "nsz"})
def meet_floor(camera: Any, heights: Any, grid: Any, floor: Any, transmittance: Any, hits: Any) -> None:
    """Where the rays of a view meet the floor, as `FloorSurface.meet` finds it.

    camera         `pack_camera`
    heights, grid  the floor surface: (rows, columns), and (3,) origin x, y and spacing
    floor          (H, W) bool, pixels that are asked for in any case
    transmittance  (H, W), which asks for every pixel through which at least `DARK` comes, as the renderer does
    hits           out (3, H, W): world x, y, and the footprint of the pixel on the floor in metres: the geometric mean
                   of its width and its length; -1 where the ray does not meet the floor or nobody asked
    """
    _, height, width = hits.shape
    for row in prange(height):
        v = (_F(row) + _F(0.5) - camera[15]) / camera[13]
        step, first = _ONE / camera[12], (_F(0.5) - camera[14]) / camera[12]
        x0, y0 = camera[1] * v + camera[2], camera[4] * v + camera[5]
        z0 = camera[7] * v + camera[8]
        mask, through = floor[row], transmittance[row]
        xs, ys, footprints = hits[0, row], hits[1, row], hits[2, row]
        for column in range(width):
            u = _F(column) * step + first
            dz = camera[6] * u + z0
            footprints[column] = -_ONE
            if dz < _F(0) and (mask[column] or through[column] >= DARK):
                forward = _ONE / np.sqrt(u * u + v * v + _ONE)
                dx, dy, dz = (camera[0] * u + x0) * forward, (camera[3] * u + y0) * forward, dz * forward
                distance = distance_to_floor(heights, grid, camera[9], camera[10], camera[11], dx, dy, dz)
                if distance > _F(0):
                    xs[column] = camera[9] + distance * dx
                    ys[column] = camera[10] + distance * dy
                    footprints[column] = footprint_of(distance, forward, dz, camera[12])


@njit(inline="always")
def _taps(level: Any, bounds: Any, x: Any, y: Any) -> Any:
    # `level` is a row of the table. The first of the four texels, the way to its neighbours, and the shares of those.
    rows, columns = level[1], level[2]
    c = (x - bounds[0]) * (_F(columns) / (bounds[2] - bounds[0])) - _F(0.5)
    r = (y - bounds[1]) * (_F(rows) / (bounds[3] - bounds[1])) - _F(0.5)
    c = min(max(c, _F(0)), _F(columns - 1))
    r = min(max(r, _F(0)), _F(rows - 1))
    c0, r0 = np.int32(c), np.int32(r)
    right = 1 if c0 < columns - 1 else 0
    up = columns if r0 < rows - 1 else 0
    return level[0] + r0 * columns + c0, right, up, c - _F(c0), r - _F(r0)


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
        xs, ys, footprints = hits[0, row], hits[1, row], hits[2, row]
        for level in range(table.shape[0]):
            here, most = table[level], _F(3) * sizes[level]
            for column in range(width):
                footprint = footprints[column]
                if footprint < _F(0) or footprint >= most:
                    continue
                weight = level_weight(footprint, sizes[level])
                at, right, up, fc, fr = _taps(here, bounds, xs[column], ys[column])
                w11 = weight * fr * fc
                w10, w01 = weight * fr - w11, weight * fc - w11
                w00 = weight - weight * fr - w01
                # Unsigned, so that nothing asks whether an index counts from the end.
                a, b = np.uintp(at), np.uintp(at + right)
                c, d = np.uintp(at + up), np.uintp(at + up + right)
                for k in range(3):
                    background[k, row, column] += (
                        w00 * texels[a, k] + w01 * texels[b, k] + w10 * texels[c, k] + w11 * texels[d, k]
                    )


@njit(parallel=True, cache=True, fastmath=True)
def scatter_texture(
    hits: Any, floor: Any, table: Any, sizes: Any, bounds: Any, values: Any, texels: Any, weights: Any
) -> None:
    """The adjoint of `add_texture` within `floor` (H, W): adds `values` (3, H, W) into `texels` (n, 3), and the weight
    with which each texel was touched into `weights` (n,) where that is not empty. A task per level: no two write to
    the same texel."""
    _, height, width = hits.shape
    for level in prange(table.shape[0]):
        here, most = table[level], _F(3) * sizes[level]
        for row in range(height):
            for column in range(width):
                footprint = hits[2, row, column]
                if not floor[row, column] or footprint < _F(0) or footprint >= most:
                    continue
                v0, v1, v2 = values[0, row, column], values[1, row, column], values[2, row, column]
                weight = level_weight(footprint, sizes[level])
                at, right, up, fc, fr = _taps(here, bounds, hits[0, row, column], hits[1, row, column])
                w11 = weight * fr * fc
                w10, w01 = weight * fr - w11, weight * fc - w11
                shares = (weight - weight * fr - w01, w01, w10, w11)
                places = (at, at + right, at + up, at + up + right)
                for corner in range(4):
                    to, share = np.uintp(places[corner]), shares[corner]
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

    def collect(self, hits: Float32, floor: NDArray[np.bool_], d_background: Float32) -> None:
        """Adds to `gradient` from dL / d(background) (3, H, W) within `floor` (H, W): what shines through half-opaque
        Gaussians elsewhere would be painted onto the floor."""
        scatter_texture(hits, floor, self.table, self.sizes, self.bounds, d_background, self.gradient, _UNWEIGHTED)

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
