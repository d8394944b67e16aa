"""The floor texture during training: grids over world x, y in one vector of texels.

A segment of pixels is first converted to texel numbers and weights, in vectors over pixels. Then each pixel's four
texels are processed as short vectors over colors. Scalar code is three times as slow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from llvmlite import ir
from numba import njit, prange, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from nvsim.render.arithmetic import FLAGS
from nvsim.render.floor_texture import level_weight
from nvsim.splats.types import FloorTexture

if TYPE_CHECKING:
    from numba.core.base import BaseContext
    from numba.core.typing.context import BaseContext as TypingContext
    from numba.core.typing.templates import Signature

Float32 = NDArray[np.float32]
Int64 = NDArray[np.int64]
Mask = NDArray[np.bool_]
_F = np.float32
_ZERO, _HALF = _F(0), _F(0.5)
_SEGMENT = 64
# Planes of a segment: world x, y, and footprint; then the weights of the right and the upper texels, and of the level.
_X, _Y, _WEIGHT, _PLANES = 3 * _SEGMENT, 4 * _SEGMENT, 5 * _SEGMENT, 6 * _SEGMENT


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
    count: int,  # of pixels, at most _SEGMENT
    plane: Float32,  # (_PLANES,) out
) -> bool:
    """Writes world x, y, and footprint of up to a segment of pixels to `plane`; returns whether any meets the floor."""
    met = False
    for i in range(count):
        plane[i] = hits[0, row, x0 + i]
    for i in range(count):
        plane[_SEGMENT + i] = hits[1, row, x0 + i]
    for i in range(count):
        footprint = hits[2, row, x0 + i]
        plane[2 * _SEGMENT + i] = footprint
        met |= footprint >= _ZERO
    return met


@njit(fastmath=FLAGS, error_model="numpy")
def _prepare(
    level: Int64,  # (3,) its row of the table: first texel, rows, columns
    size: np.float32,  # of a texel, meters
    bounds: Float32,  # (4,) low x, y, high x, y, meters, world
    plane: Float32,  # (_PLANES,) of `_load`; the bilinear weights and the level weights are written
    texels: NDArray[np.int32],  # (_SEGMENT,) out: number of the lower left texel
) -> None:
    """The lower left of the four texels, the weights of the right and the upper ones, and of the level, of a
    segment."""
    rows, columns = np.int32(level[1]), np.int32(level[2])
    low_x, low_y = bounds[0], bounds[1]
    across, along = _F(columns) / (bounds[2] - low_x), _F(rows) / (bounds[3] - low_y)
    last_column, last_row = _F(columns - np.int32(1)), _F(rows - np.int32(1))
    # At the border the second texel gets the full weight, so that there are always two.
    first, before_column, before_row = np.int32(level[0]), columns - np.int32(2), rows - np.int32(2)
    for i in range(_SEGMENT):
        c = min(max((plane[i] - low_x) * across - _HALF, _ZERO), last_column)
        r = min(max((plane[_SEGMENT + i] - low_y) * along - _HALF, _ZERO), last_row)
        c0, r0 = min(np.int32(c), before_column), min(np.int32(r), before_row)
        footprint = plane[2 * _SEGMENT + i]
        plane[_X + i], plane[_Y + i] = c - _F(c0), r - _F(r0)
        plane[_WEIGHT + i] = level_weight(footprint, size) if footprint >= _ZERO else _ZERO
        texels[i] = first + r0 * columns + c0


@njit(parallel=True, cache=True, fastmath=FLAGS, error_model="numpy")
def add_texture(
    hits: Float32,  # (3, H, W) `floor_rays.meet_floor`: world x and y and the footprint, meters
    table: Int64,  # (levels, 3) first texel, rows, columns, both of them at least 2
    sizes: Float32,  # (levels,) texel size, meters
    bounds: Float32,  # (4,) low x, y, high x, y, meters, world
    texels: Float32,  # (T, 3) colors, all levels in one array
    background: Float32,  # (3, H, W) colors, changed
) -> None:
    """Adds the texture to `background` at the pixels whose rays meet the floor."""
    _, height, width = hits.shape
    flat = texels.reshape(-1)
    for row in prange(height):
        places, plane = np.empty(_SEGMENT, np.int32), np.zeros(_PLANES, np.float32)
        for x0 in range(0, width, _SEGMENT):
            count = min(_SEGMENT, width - x0)
            past = x0 + count
            if not _load(hits, row, x0, count, plane):
                continue
            reds, greens, blues = background[0, row, x0:past], background[1, row, x0:past], background[2, row, x0:past]
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
                    color = _blend_texels(flat, at, at + columns, lower - w01, w01, upper - w11, w11)  # type: ignore[arg-type, call-arg, var-annotated]
                    reds[i] += color[0]
                    greens[i] += color[1]
                    blues[i] += color[2]


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
        places, plane = np.empty(_SEGMENT, np.int32), np.zeros(_PLANES, np.float32)
        columns = np.uintp(table[level, 2])
        for row in range(height):
            for x0 in range(0, width, _SEGMENT):
                count = min(_SEGMENT, width - x0)
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


TEXELS = (0.4, 0.1, 0.04, 0.015)
"""Texel sizes in meters, coarse to fine."""
LARGEST = 2600
"""Greatest number of texels of a level along one side; a larger area gets larger texels."""


class LearnedTexture:
    """Texels over an area, initially zero. The optimizer changes `values` (n, 3) in place, from `gradient` (n, 3)."""

    def __init__(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        self._low, self._high = low, high
        self.bounds = np.array([*low, *high], np.float32)
        table, sizes, first = [], [], 0
        for texel in TEXELS:
            columns = int(np.clip(np.ceil((high[0] - low[0]) / texel), 2, LARGEST))
            rows = int(np.clip(np.ceil((high[1] - low[1]) / texel), 2, LARGEST))
            table.append((first, rows, columns))
            sizes.append(max((high[0] - low[0]) / columns, (high[1] - low[1]) / rows))
            first += rows * columns
        self.table, self.sizes = np.array(table, np.int64), np.array(sizes, np.float32)
        self.values = np.zeros((first, 3), np.float32)
        self.gradient = np.zeros_like(self.values)

    def add(self, hits: Float32, background: Float32) -> None:
        """Adds the texture to `background` (3, H, W); `hits` (3, H, W) come from `floor_rays.meet_floor`."""
        add_texture(hits, self.table, self.sizes, self.bounds, self.values, background)

    def collect(self, hits: Float32, floor: NDArray[np.bool_], d_background: Float32) -> None:
        """Adds to `gradient` from `d_background` (3, H, W), the gradient of the background, only within `floor` (H, W).
        Elsewhere, colors seen through half-opaque Gaussians would be painted onto the floor."""
        scatter_texture(hits, floor, self.table, self.sizes, self.bounds, d_background, self.gradient, _UNWEIGHTED)

    def level(self, index: int) -> slice:
        """The texels of one level within `values`."""
        first, rows, columns = self.table[index]
        return slice(int(first), int(first + rows * columns))

    def exported(self) -> FloorTexture:
        """A copy in the form that the renderer uses."""
        levels = tuple(
            self.values[self.level(i)].reshape(rows, columns, 3).copy()
            for i, (_, rows, columns) in enumerate(self.table)
        )
        return FloorTexture(levels, self._low, self._high)


_UNWEIGHTED = np.empty(0, np.float32)
