"""The floor texture along one ray: where the ray meets the floor surface, how much floor a pixel covers there, and
which levels contribute. Compiled into the background kernel; the texels of all levels are in one array.

A level is a residual over the coarser levels. If a pixel covers more floor than a texel, the level is faded out rather
than filtered. The coarser image remains, as with mip levels, and no level must be computed in advance.
"""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass

import numpy as np
from numba import njit

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.render.arithmetic import FLAGS
from nvsim.render.kernel_types import Float32, Int64, Vector3
from nvsim.splats.types import FloorTexture

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
FLATTEST = _F(-0.02)  # as FloorSurface.distance_along_rays
ITERATIONS = 4
CLOSE = _F(1e-5)  # meters; further iterations change nothing


@dataclass(frozen=True, eq=False)
class PackedTexture:
    """A FloorTexture in the form for the kernels.

    texels   (n, 3) float32, all levels one after the other
    table    (levels, 3) int64: first texel, rows, columns
    sizes    (levels,) float32: texel size in meters, the larger of its sides
    bounds   (4,) float32: low x, low y, high x, high y; meters
    """

    texels: Float32
    table: Int64
    sizes: Float32
    bounds: Float32


_packed: weakref.WeakKeyDictionary[FloorTexture, PackedTexture] = weakref.WeakKeyDictionary()
NO_TEXTURE = PackedTexture(
    np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int64), np.zeros(0, np.float32), np.zeros(4, np.float32)
)


def pack_texture(texture: FloorTexture | None) -> PackedTexture:
    """The texture for the kernels, cached while `texture` exists. Do not change its levels in place after it was
    drawn."""
    if texture is None or not texture.levels:
        return NO_TEXTURE
    known = _packed.get(texture)
    if known is None:
        known = _packed[texture] = _pack(texture)
    return known


def _pack(texture: FloorTexture) -> PackedTexture:
    table, sizes, first = [], [], 0
    width, height = texture.high[0] - texture.low[0], texture.high[1] - texture.low[1]
    for level in texture.levels:
        rows, columns = level.shape[:2]
        table.append((first, rows, columns))
        sizes.append(max(width / columns, height / rows))
        first += rows * columns
    texels = np.concatenate([np.asarray(level, np.float32).reshape(-1, 3) for level in texture.levels])
    bounds = np.array([*texture.low, *texture.high], np.float32)
    return PackedTexture(texels, np.array(table, np.int64), np.array(sizes, np.float32), bounds)


def pack_floor(floor: FloorSurface) -> tuple[Float32, Float32]:
    """Heights (rows, columns), and origin x, y and spacing (3,); meters."""
    heights = np.require(floor.heights, np.float32, ["C", "A", "W"])
    return heights, np.array([*floor.origin, floor.spacing], np.float32)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def level_weight(
    footprint: np.float32,  # meters, see `footprint_of`
    texel: np.float32,  # meters
) -> np.float32:
    """The weight of a level with this texel size for a pixel with this footprint: 1 up to one texel, 0 from three
    texels on."""
    return min(max(_F(1.5) - _HALF * footprint / texel, _ZERO), _ONE)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def height_at(
    heights: Float32,  # (rows, columns) meters, world z
    grid: Float32,  # (3,) origin x and y and the spacing, meters, world
    x: np.float32,  # meters, world, as y
    y: np.float32,
) -> np.float32:
    """FloorSurface.height_at: meters; `heights` (rows, columns) and `grid` (3,) from `pack_floor`."""
    rows, columns = heights.shape
    c = min(max((x - grid[0]) / grid[2], _ZERO), _F(columns - 1))
    r = min(max((y - grid[1]) / grid[2], _ZERO), _F(rows - 1))
    c0, r0 = np.int64(c), np.int64(r)
    c1, r1 = min(c0 + 1, columns - 1), min(r0 + 1, rows - 1)
    fc, fr = c - _F(c0), r - _F(r0)
    low = heights[r0, c0] * (_ONE - fc) + heights[r0, c1] * fc
    high = heights[r1, c0] * (_ONE - fc) + heights[r1, c1] * fc
    return low * (_ONE - fr) + high * fr


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def distance_to_floor(
    heights: Float32,  # (rows, columns) meters, world z
    grid: Float32,  # (3,) origin x and y and the spacing, meters, world
    ex: np.float32,  # camera position, meters, world, as ey and ez
    ey: np.float32,
    ez: np.float32,
    dx: np.float32,  # unit direction, world, as dy and dz
    dy: np.float32,
    dz: np.float32,
) -> np.float32:
    """FloorSurface.distance_along_rays: meters along the unit direction from the camera, -1 if there is none.
    `heights` is (rows, columns), `grid` (3,)."""
    if not dz < FLATTEST:
        return -_ONE
    distance = (height_at(heights, grid, ex, ey) - ez) / dz
    if heights.size > 1:
        for _ in range(ITERATIONS):
            before = distance
            distance = (height_at(heights, grid, ex + distance * dx, ey + distance * dy) - ez) / dz
            if abs(distance - before) < CLOSE:
                break
    return distance if distance > _ZERO else -_ONE


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def footprint_of(
    distance: np.float32,  # meters along the ray
    forward: np.float32,  # the ray's component along the optical axis, at most 1
    dz: np.float32,  # the ray's component upward, below zero
    focal: np.float32,  # pixels
) -> np.float32:
    """Meters of floor that a pixel covers: the geometric mean of its width and its length."""
    return distance * forward / (focal * math.sqrt(-dz))


@njit(fastmath=FLAGS, error_model="numpy")
def texture_color(
    texels: Float32,  # (n, 3) colors, all levels in one array
    table: Int64,  # (levels, 3) first texel, rows, columns
    sizes: Float32,  # (levels,) texel size, meters
    bounds: Float32,  # (4,) low x, low y, high x, high y, meters, world
    x: np.float32,  # meters, world, as y
    y: np.float32,
    footprint: np.float32,  # meters, see `footprint_of`
) -> Vector3:
    """Red, green, and blue at world x, y: the weighted sum of the levels' bilinear samples of `texels` (n, 3)."""
    red = green = blue = _ZERO
    for level in range(table.shape[0]):
        weight = level_weight(footprint, sizes[level])
        if weight <= _ZERO:
            continue
        first, rows, columns = table[level, 0], table[level, 1], table[level, 2]
        c = (x - bounds[0]) / (bounds[2] - bounds[0]) * _F(columns) - _HALF
        r = (y - bounds[1]) / (bounds[3] - bounds[1]) * _F(rows) - _HALF
        c, r = min(max(c, _ZERO), _F(columns - 1)), min(max(r, _ZERO), _F(rows - 1))
        c0, r0 = np.int64(c), np.int64(r)
        right, up = min(c0 + 1, columns - 1) - c0, (min(r0 + 1, rows - 1) - r0) * columns
        fc, fr = c - _F(c0), r - _F(r0)
        at = first + r0 * columns + c0
        w00, w01 = weight * (_ONE - fr) * (_ONE - fc), weight * (_ONE - fr) * fc
        w10, w11 = weight * fr * (_ONE - fc), weight * fr * fc
        a, b, c_, d = texels[at], texels[at + right], texels[at + up], texels[at + up + right]
        red += w00 * a[0] + w01 * b[0] + w10 * c_[0] + w11 * d[0]
        green += w00 * a[1] + w01 * b[1] + w10 * c_[1] + w11 * d[1]
        blue += w00 * a[2] + w01 * b[2] + w10 * c_[2] + w11 * d[2]
    return red, green, blue
