"""The colors of the floor texture where rays meet the floor, and their gradient. The texels of all levels are in one
array.

A level is a residual over the coarser levels. If a pixel covers more floor than a texel, the level is faded out rather
than filtered. The coarser image remains, as with mip levels, and no level must be computed in advance.

A segment of pixels is first converted to texel numbers and weights, in vectors over pixels. Then each pixel's four
texels are processed as short vectors over colors. Scalar code is three times as slow.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS
from nvsim.render.floor_rays import HITS, SEGMENT
from nvsim.render.kernel_types import Float32, Int64, Mask
from nvsim.splats.types import FloorTexture

if TYPE_CHECKING:
    from numba.core.base import BaseContext
    from numba.core.typing.context import BaseContext as TypingContext
    from numba.core.typing.templates import Signature

_F = np.float32
_ZERO, _ONE, _HALF = _F(0), _F(1), _F(0.5)
# The planes of a segment: those of `floor_rays.HITS`, then the weights of the right and the upper texels, and of the
# level.
_X, _Y, _WEIGHT = HITS, HITS + SEGMENT, HITS + 2 * SEGMENT
PLANES = HITS + 3 * SEGMENT
"""Size of the planes of a segment for `add_segment`."""


@dataclass(frozen=True, eq=False)
class PackedTexture:
    """A FloorTexture in the form for the kernels.

    texels   (n, 3) float32, all levels one after the other
    table    (levels, 3) int64: first texel, rows, columns, both of them at least 2
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
    table, sizes, levels, first = [], [], [], 0
    width, height = texture.high[0] - texture.low[0], texture.high[1] - texture.low[1]
    for level in texture.levels:
        rows, columns = level.shape[:2]
        sizes.append(max(width / columns, height / rows))
        level = np.asarray(level, np.float32)
        for axis in (0, 1):
            level = level if level.shape[axis] > 1 else np.repeat(level, 2, axis)
        table.append((first, *level.shape[:2]))
        levels.append(level.reshape(-1, 3))
        first += len(levels[-1])
    texels = np.concatenate(levels)
    bounds = np.array([*texture.low, *texture.high], np.float32)
    return PackedTexture(texels, np.array(table, np.int64), np.array(sizes, np.float32), bounds)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def level_weight(
    footprint: np.float32,  # meters, see `floor_rays.meet_segment`
    texel: np.float32,  # meters
) -> np.float32:
    """The weight of a level with this texel size for a pixel with this footprint: 1 up to one texel, 0 from three
    texels on."""
    return min(max(_F(1.5) - _HALF * footprint / texel, _ZERO), _ONE)


def _lanes(count: int) -> ir.VectorType:
    return ir.VectorType(ir.FloatType(), count)


def _vector(builder: ir.IRBuilder, scalars: list[ir.Value]) -> ir.Value:
    made = ir.Constant(_lanes(len(scalars)), ir.Undefined)
    for i, scalar in enumerate(scalars):
        made = builder.insert_element(made, scalar, ir.Constant(ir.IntType(32), i))
    return made


def _select_lanes(builder: ir.IRBuilder, vector: ir.Value, lanes: list[int]) -> ir.Value:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)


class _TexelPair:
    """Two adjacent texels, six floats; no memory outside of them is read or written."""

    def __init__(
        self, context: BaseContext, builder: ir.IRBuilder, array_type: types.Type, array: ir.Value, texel: ir.Value
    ) -> None:
        self._builder = builder
        data = context.make_array(array_type)(context, builder, array).data
        self._at = builder.mul(texel, ir.Constant(texel.type, 3))
        self._data = data

    def pointer(self, offset: int, count: int) -> ir.Value:
        b = self._builder
        place = b.gep(self._data, [b.add(self._at, ir.Constant(self._at.type, offset))])
        return b.bitcast(place, _lanes(count).as_pointer())

    def load(self, offset: int, count: int) -> ir.Value:
        return self._builder.load(self.pointer(offset, count), align=4)

    def add(self, offset: int, value: ir.Value) -> None:
        count = value.type.count
        total = self._builder.fadd(self.load(offset, count), value, flags=("contract",))
        self._builder.store(total, self.pointer(offset, count), align=4)


# The two intrinsics are declared over types, after numba's typing context; kernels call them with values, without it.
@intrinsic
def _blend_texels(
    typing_context: TypingContext,
    texels: types.Type,  # of (3 T,) float32
    low: types.Type,  # of uintp, as `high`
    high: types.Type,
    w00: types.Type,  # of float32, as the other weights
    w01: types.Type,
    w10: types.Type,
    w11: types.Type,
) -> tuple[Signature, Callable[..., ir.Value]]:
    """The color w00 texel(low) + w01 texel(low + 1) + w10 texel(high) + w11 texel(high + 1); `texels` flat."""

    def build(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: list[ir.Value]) -> ir.Value:
        array, at_low, at_high, *shares = arguments
        rows = [_TexelPair(context, builder, signature.args[0], array, at) for at in (at_low, at_high)]
        flags = ("contract", "reassoc")
        left = right = None
        for row, (ours, next_) in zip(rows, (shares[:2], shares[2:]), strict=True):
            # The right texel is the last three lanes, which start at the blue channel of the left texel.
            a = builder.fmul(row.load(0, 4), _vector(builder, [ours] * 4), flags=flags)
            b = builder.fmul(row.load(2, 4), _vector(builder, [next_] * 4), flags=flags)
            left = a if left is None else builder.fadd(left, a, flags=flags)
            right = b if right is None else builder.fadd(right, b, flags=flags)
        total = builder.fadd(left, _select_lanes(builder, right, [1, 2, 3, 3]), flags=flags)
        colors = [builder.extract_element(total, ir.Constant(ir.IntType(32), i)) for i in range(3)]
        return context.make_tuple(builder, signature.return_type, colors)

    return types.UniTuple(types.float32, 3)(texels, low, high, w00, w01, w10, w11), build


@intrinsic
def _scatter_texels(
    typing_context: TypingContext,
    texels: types.Type,  # of (3 T,) float32
    low: types.Type,  # of uintp
    left: types.Type,  # of float32, as all following
    right: types.Type,
    red: types.Type,
    green: types.Type,
    blue: types.Type,
) -> tuple[Signature, Callable[..., ir.Value]]:
    """texel(low) += left (red, green, blue), texel(low + 1) += right (red, green, blue); `texels` flat."""

    def build(context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: list[ir.Value]) -> ir.Value:
        array, at, ours, next_, *color = arguments
        row = _TexelPair(context, builder, signature.args[0], array, at)
        r, g, b = color
        # Groups of four and two floats that do not overlap, so that additions of the next pixel to the same texels need
        # not wait for the cache.
        first = builder.fmul(_vector(builder, [r, g, b, r]), _vector(builder, [ours, ours, ours, next_]))
        row.add(0, first)
        row.add(4, builder.fmul(_vector(builder, [g, b]), _vector(builder, [next_, next_])))
        return context.get_dummy_value()

    return types.void(texels, low, left, right, red, green, blue), build


@njit(fastmath=FLAGS, error_model="numpy")
def _load(
    hits: Float32,  # (3, H, W) `floor_rays.meet_floor`
    row: int,
    x0: int,  # first column of the segment
    count: int,  # of pixels, at most SEGMENT
    plane: Float32,  # (PLANES,) out
) -> bool:
    """Writes world x, y, and footprint of up to a segment of pixels to `plane`; returns whether any meets the floor."""
    met = False
    for i in range(count):
        plane[i] = hits[0, row, x0 + i]
    for i in range(count):
        plane[SEGMENT + i] = hits[1, row, x0 + i]
    for i in range(count):
        footprint = hits[2, row, x0 + i]
        plane[2 * SEGMENT + i] = footprint
        met |= footprint >= _ZERO
    return met


@njit(fastmath=FLAGS, error_model="numpy")
def _prepare(
    level: Int64,  # (3,) its row of the table: first texel, rows, columns
    size: np.float32,  # of a texel, meters
    bounds: Float32,  # (4,) low x, y, high x, y, meters, world
    plane: Float32,  # (PLANES,) of `_load`; the bilinear weights and the level weights are written
    texels: NDArray[np.int32],  # (SEGMENT,) out: number of the lower left texel
) -> None:
    """The lower left of the four texels, the weights of the right and the upper ones, and of the level, of a
    segment."""
    rows, columns = np.int32(level[1]), np.int32(level[2])
    low_x, low_y = bounds[0], bounds[1]
    across, along = _F(columns) / (bounds[2] - low_x), _F(rows) / (bounds[3] - low_y)
    last_column, last_row = _F(columns - np.int32(1)), _F(rows - np.int32(1))
    # At the border the second texel gets the full weight, so that there are always two.
    first, before_column, before_row = np.int32(level[0]), columns - np.int32(2), rows - np.int32(2)
    for i in range(SEGMENT):
        c = min(max((plane[i] - low_x) * across - _HALF, _ZERO), last_column)
        r = min(max((plane[SEGMENT + i] - low_y) * along - _HALF, _ZERO), last_row)
        c0, r0 = min(np.int32(c), before_column), min(np.int32(r), before_row)
        footprint = plane[2 * SEGMENT + i]
        plane[_X + i], plane[_Y + i] = c - _F(c0), r - _F(r0)
        plane[_WEIGHT + i] = level_weight(footprint, size) if footprint >= _ZERO else _ZERO
        texels[i] = first + r0 * columns + c0


@njit(fastmath=FLAGS, error_model="numpy")
def add_segment(
    table: Int64,  # as in `PackedTexture`, like the next two
    sizes: Float32,
    bounds: Float32,
    texels: Float32,  # (3 n,) the colors, flat
    count: int,  # of pixels, at most SEGMENT
    plane: Float32,  # (PLANES,) the hits; the rest is scratch
    places: NDArray[np.int32],  # (SEGMENT,) scratch
    reds: Float32,  # (count,) changed, as the next two
    greens: Float32,
    blues: Float32,
) -> None:
    """Adds the texture to the colors of a segment of pixels where their rays meet the floor."""
    for level in range(table.shape[0]):
        _prepare(table[level], sizes[level], bounds, plane, places)
        columns = np.uintp(table[level, 2])
        for i in range(count):
            weight = plane[_WEIGHT + i]
            if weight <= _ZERO:
                continue
            fc, upper = plane[_X + i], weight * plane[_Y + i]
            lower, w11 = weight - upper, upper * fc
            w01 = lower * fc
            at = np.uintp(places[i])
            color = _blend_texels(texels, at, at + columns, lower - w01, w01, upper - w11, w11)  # type: ignore[arg-type, call-arg, var-annotated]
            reds[i] += color[0]
            greens[i] += color[1]
            blues[i] += color[2]


@njit(parallel=True, cache=True, fastmath=FLAGS, error_model="numpy")
def add_texture(
    hits: Float32,  # (3, H, W) `floor_rays.meet_floor`: world x and y and the footprint, meters
    table: Int64,  # (levels, 3) first texel, rows, columns, both of them at least 2
    sizes: Float32,  # (levels,) texel size, meters
    bounds: Float32,  # (4,) low x, low y, high x, high y, meters, world
    texels: Float32,  # (n, 3) colors, all levels in one array
    background: Float32,  # (3, H, W) colors, changed
) -> None:
    """Adds the texture to `background` at the pixels whose rays meet the floor."""
    _, height, width = hits.shape
    flat = texels.reshape(-1)
    for row in prange(height):
        places, plane = np.empty(SEGMENT, np.int32), np.zeros(PLANES, np.float32)
        for x0 in range(0, width, SEGMENT):
            count = min(SEGMENT, width - x0)
            past = x0 + count
            if _load(hits, row, x0, count, plane):
                reds, greens = background[0, row, x0:past], background[1, row, x0:past]
                add_segment(table, sizes, bounds, flat, count, plane, places, reds, greens, background[2, row, x0:past])


@njit(parallel=True, cache=True, fastmath=FLAGS, error_model="numpy")
def scatter_texture(
    hits: Float32,  # (3, H, W) `floor_rays.meet_floor`: world x and y and the footprint, meters
    floor: Mask,  # (H, W) pixels that count
    table: Int64,  # (levels, 3) first texel, rows, columns, both of them at least 2
    sizes: Float32,  # (levels,) texel size, meters
    bounds: Float32,  # (4,) low x, y, high x, y, meters, world
    values: Float32,  # (3, H, W) values to distribute: colors, or their gradient
    texels: Float32,  # (T, 3) changed
    weights: Float32,  # (T,) changed, or (0,) if weights are not needed
) -> None:
    """The adjoint of `add_texture` within `floor`: adds `values` to `texels`, and the weight of each contribution to
    `weights`. Each level is one task, so no two tasks write to the same texel, and the sums do not depend on the number
    of threads."""
    _, height, width = hits.shape
    flat = texels.reshape(-1)
    for level in prange(table.shape[0]):
        places, plane = np.empty(SEGMENT, np.int32), np.zeros(PLANES, np.float32)
        columns = np.uintp(table[level, 2])
        for row in range(height):
            for x0 in range(0, width, SEGMENT):
                count = min(SEGMENT, width - x0)
                past = x0 + count
                mask = floor[row, x0:past]
                wanted = False
                for i in range(count):
                    wanted |= mask[i]
                if not wanted or not _load(hits, row, x0, count, plane):
                    continue
                _prepare(table[level], sizes[level], bounds, plane, places)
                reds, greens, blues = values[0, row, x0:past], values[1, row, x0:past], values[2, row, x0:past]
                for i in range(count):
                    weight = plane[_WEIGHT + i]
                    if weight <= _ZERO or not mask[i]:
                        continue
                    fc, upper = plane[_X + i], weight * plane[_Y + i]
                    lower, w11 = weight - upper, upper * fc
                    w01 = lower * fc
                    at = np.uintp(places[i])
                    red, green, blue = reds[i], greens[i], blues[i]
                    _scatter_texels(flat, at, lower - w01, w01, red, green, blue)  # type: ignore[arg-type, call-arg]
                    _scatter_texels(flat, at + columns, upper - w11, w11, red, green, blue)
                    if weights.size > 0:
                        weights[at] += lower - w01
                        weights[at + np.uintp(1)] += w01
                        weights[at + columns] += upper - w11
                        weights[at + columns + np.uintp(1)] += w11
