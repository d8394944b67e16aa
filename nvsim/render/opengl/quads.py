"""Converts splats to the quads that OpenGL draws, nearest first: a radix sort by depth, then one short row per quad.

The quad is the rectangle along the axes of the ellipse, at the exact extent where alpha falls to 1/255. It covers fewer
pixels than an axis-aligned box. Within it alpha depends on one number, the squared distance from the center in units of
the ellipse.
"""

from __future__ import annotations

import math

import numpy as np

from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import depth_key
from nvsim.render.kernel_types import (
    BLUE,
    CONIC_B,
    CONIC_C,
    DEPTH,
    GREEN,
    HALF_HEIGHT,
    HALF_WIDTH,
    LOG_CUT,
    LOG_OPACITY,
    RED,
    Float32,
    Int32,
    UInt32,
    X,
    Y,
)

_F = np.float32
_ZERO, _HALF, _ONE = _F(0), _F(0.5), _F(1)
QUAD_WIDTH = 10
"""Number of floats of a quad: center x, y in pixels from the corner of the image; the long and the short semi-axis, x,
y each; red, green, blue; log2 of the opacity."""
_BITS = 12
_MASK = np.uint32((1 << _BITS) - 1)


@njit(cache=True, nogil=True)
def nearest_first(
    splats: Float32,  # (N, 16) of RenderBuffers.splats
    visible: Int32,  # (blocks,) of RenderBuffers.splats
    keys: UInt32,  # (N or more,) scratch
    order: Int32,  # (N or more,) out: rows of splats, at the start
    spare_keys: UInt32,  # (N or more,) scratch
    spare_order: Int32,  # (N or more,) scratch
) -> int:
    """Writes the rows of `splats` (N, 16) to draw to the start of `order` (N or more,), nearest first; returns their
    number. Depths are compared by the upper 24 bits of their range: to a relative 4e-6 between 5 cm and 20 m."""
    n, blocks = splats.shape[0], visible.shape[0]
    count = 0
    low, high = np.uint32(0xFFFFFFFF), np.uint32(0)
    for block in range(blocks):
        first = n * block // blocks
        for i in range(first, first + visible[block]):
            key = depth_key(splats[i, DEPTH])
            low, high = min(low, key), max(high, key)
            keys[count], order[count] = key, i
            count += 1
    shift = np.uint32(0)
    while count > 0 and (high - low) >> shift >= np.uint32(1 << (2 * _BITS)):
        shift += np.uint32(1)
    fine, coarse = np.zeros((1 << _BITS) + 1, np.int64), np.zeros((1 << _BITS) + 1, np.int64)
    for i in range(count):
        key = (keys[i] - low) >> shift
        keys[i] = key
        fine[(key & _MASK) + 1] += 1
        coarse[(key >> np.uint32(_BITS)) + 1] += 1
    for d in range(1 << _BITS):
        fine[d + 1] += fine[d]
        coarse[d + 1] += coarse[d]
    for i in range(count):
        d = keys[i] & _MASK
        spare_keys[fine[d]], spare_order[fine[d]] = keys[i], order[i]
        fine[d] += 1
    for i in range(count):
        d = spare_keys[i] >> np.uint32(_BITS)
        order[coarse[d]] = spare_order[i]
        coarse[d] += 1
    return count


@njit(forceinline=True, error_model="numpy")
def _direction(half: np.float32, xy: np.float32, spread: np.float32) -> tuple[np.float32, np.float32]:
    """Cosine and sine of half the angle of the vector (half, xy), whose length is `spread`."""
    if not spread > _ZERO:
        return _ONE, _ZERO
    # The larger of the two first: the other one then follows without cancellation.
    if half >= _ZERO:
        cosine = _F(math.sqrt(_HALF + _HALF * half / spread))
        return cosine, _F(_HALF * xy / (spread * cosine))
    sine = _F(math.sqrt(_HALF - _HALF * half / spread))
    return _F(_HALF * xy / (spread * sine)), sine


# The ellipse is the set p^T Q p = m, with Q from the negated conic and m = log2(255 opacity). Of E = m Q^-1 the
# diagonal is known (the squared half extents), and E01 = -Q01 E00 / Q11; its eigenvalues are the squared semi-axes.
# Their product is computed as m E00 / Q11 rather than E00 E11 - E01^2, which cancels for long thin splats.
@njit(error_model="numpy")
def _write_quad(
    splat: Float32,  # (16,) as in render.layout
    quad: Float32,  # (QUAD_WIDTH,) out
) -> None:
    xx, yy = splat[HALF_WIDTH] * splat[HALF_WIDTH], splat[HALF_HEIGHT] * splat[HALF_HEIGHT]
    ratio = xx / -splat[CONIC_C]
    xy = _HALF * splat[CONIC_B] * ratio
    half = _HALF * (xx - yy)
    spread = _F(math.sqrt(half * half + xy * xy))
    long = _HALF * (xx + yy) + spread
    short = max((splat[LOG_OPACITY] - LOG_CUT) * ratio, _ZERO) / long
    cosine, sine = _direction(half, xy, spread)
    long, short = math.sqrt(long), math.sqrt(short)
    quad[0], quad[1] = splat[X] + _HALF, splat[Y] + _HALF
    quad[2], quad[3] = long * cosine, long * sine
    quad[4], quad[5] = -short * sine, short * cosine
    quad[6], quad[7], quad[8] = splat[RED], splat[GREEN], splat[BLUE]
    quad[9] = splat[LOG_OPACITY]


@njit(parallel=True, cache=True, nogil=True)
def write_quads(
    splats: Float32,  # (N, 16) columns as in render.layout
    order: Int32,  # (count or more,) rows of splats, of `nearest_first`
    count: int,
    threads: int,  # number of tasks that share the quads
    quads: Float32,  # (count or more, QUAD_WIDTH) out
) -> None:
    """Writes the splats of the first `count` entries of `order` as quads (count, QUAD_WIDTH), in that order."""
    for thread in prange(threads):
        for k in range(count * thread // threads, count * (thread + 1) // threads):
            _write_quad(splats[order[k]], quads[k])
