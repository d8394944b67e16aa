"""Projects world Gaussians to splats on the image: EWA projection, opacity compensation, color from spherical
harmonics.

These are equations 3 to 5 of Kerbl et al. 2023, with the local affine approximation of Zwicker et al. 2001. The opacity
compensation is that of Yu et al. 2024 (Mip-Splatting): rho = sqrt(det S / det (S + eps I)).
"""

from __future__ import annotations

import math

import numpy as np

from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS, LOG2E, exp2
from nvsim.render.chunk import BASIS, CHUNK, PLANES, harmonics_of, splats_of
from nvsim.render.ellipse_extent import tile_box, tile_columns
from nvsim.render.ewa import to_camera
from nvsim.render.kernel_types import (
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    DEPTH,
    GREEN,
    HALF_HEIGHT,
    HALF_WIDTH,
    LOG_OPACITY,
    NORMAL,
    OPACITY,
    RED,
    TILE,
    Float32,
    Int32,
    Int64,
    Mask,
    X,
    Y,
)
from nvsim.splats import harmonics

_F = np.float32
_ZERO, _ONE, _HALF, _DC = _F(0), _F(1), _F(0.5), _F(harmonics.DC)
_MOST_REACH = _F(math.sqrt(2 * math.log(255)))  # standard deviations at which alpha 1 has fallen to 1/255


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _write_color(
    row: Float32,  # (16,) out, as in render.layout
    sh: Float32,  # (K, 3) of the Gaussian
    count: int,  # number of evaluated coefficients
    planes: Float32,  # (PLANES * CHUNK + 1,) as in `chunk`
    i: int,  # place of the Gaussian in the planes
    g: int,  # number of the Gaussian
    features: Float32,  # (N, F) or (0, F)
    matrix: Float32,  # (3, F)
) -> None:
    red = green = blue = _ZERO
    if features.shape[0] > 0:
        for f in range(features.shape[1]):
            value = features[g, f]
            red += value * matrix[0, f]
            green += value * matrix[1, f]
            blue += value * matrix[2, f]
    red, green, blue = _HALF + _DC * red, _HALF + _DC * green, _HALF + _DC * blue
    for k in range(count):
        value = planes[(BASIS + k) * CHUNK + i]
        red += value * sh[k, 0]
        green += value * sh[k, 1]
        blue += value * sh[k, 2]
    row[RED], row[GREEN], row[BLUE] = max(red, _F(0)), max(green, _F(0)), max(blue, _F(0))


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _gather_seen(
    first: int,
    end: int,
    means: Float32,  # (3 N,) meters, world
    log_scales: Float32,  # (3 N,) natural logarithm of meters
    quats: Float32,  # (4 N,) w x y z
    opacity_logits: Float32,  # (N,)
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    seen: Int64,  # (CHUNK,) out
    planes: Float32,  # (PLANES * CHUNK + 1,) out: the first twelve; others are scratch
) -> int:
    """Writes the numbers of the Gaussians of [first, end) that can be in view to `seen`, and their parameters to
    `planes`. Most Gaussians are out of view; the largest scale and the greatest extent show this at little cost."""
    for i in range(end - first):
        g = 3 * (first + i)
        planes[12 * CHUNK + i], planes[13 * CHUNK + i], planes[14 * CHUNK + i] = means[g], means[g + 1], means[g + 2]
        planes[15 * CHUNK + i] = max(log_scales[g], max(log_scales[g + 1], log_scales[g + 2]))
    for i in range(CHUNK):
        wx, wy, wz = planes[12 * CHUNK + i], planes[13 * CHUNK + i], planes[14 * CHUNK + i]
        x, y, z = to_camera(view, wx, wy, wz)
        x, y, z = x + view[9], y + view[10], z + view[11]
        iz = _ONE / z
        u, v = view[12] * x * iz + view[14] - _HALF, view[13] * y * iz + view[15] - _HALF
        widest = min(max(LOG2E * planes[15 * CHUNK + i], _F(-30)), _F(30))
        stretch = exp2(widest) * iz * max(view[12], view[13]) * view[28]
        most = _MOST_REACH * math.sqrt(stretch * stretch + view[25])
        across = u + most > view[29] and u - most < view[30]
        along = v + most > view[31] and v - most < view[32]
        planes[i], planes[CHUNK + i], planes[2 * CHUNK + i] = x, y, z
        planes[3 * CHUNK + i] = _ONE if (z > view[27] and z < _F(1e6) and across and along) else _F(0)
    count = 0
    for i in range(end - first):
        if planes[3 * CHUNK + i] != _ONE:
            continue
        g = first + i
        seen[count] = g
        # `count` is never ahead of i, so unread values stay.
        planes[count], planes[CHUNK + count], planes[2 * CHUNK + count] = (
            planes[i],
            planes[CHUNK + i],
            planes[2 * CHUNK + i],
        )
        planes[4 * CHUNK + count], planes[5 * CHUNK + count], planes[6 * CHUNK + count] = (
            log_scales[3 * g],
            log_scales[3 * g + 1],
            log_scales[3 * g + 2],
        )
        planes[7 * CHUNK + count], planes[8 * CHUNK + count] = quats[4 * g], quats[4 * g + 1]
        planes[9 * CHUNK + count], planes[10 * CHUNK + count] = quats[4 * g + 2], quats[4 * g + 3]
        planes[11 * CHUNK + count] = opacity_logits[g]
        count += 1
    return count


@njit(fastmath=FLAGS, error_model="numpy")
def _project_part(
    block: int,
    means: Float32,  # as in `project`, like all following
    log_scales: Float32,
    quats: Float32,
    opacity_logits: Float32,
    sh: Float32,
    features: Float32,
    matrix: Float32,
    degree: int,
    view: Float32,
    wanted: Mask,
    blocks: int,
    splats: Float32,
    ids: Int32,
    visible: Int32,
    tile_counts: Int32,
) -> None:
    n = means.shape[0]
    columns = (np.int64(view[16]) + TILE - 1) // TILE
    lines = (np.int64(view[17]) + TILE - 1) // TILE
    first, end = n * block // blocks, n * (block + 1) // blocks
    counts = tile_counts[block]
    counts[:] = 0
    seen = np.empty(CHUNK, np.int64)
    planes = np.empty(PLANES * CHUNK + 1, np.float32)
    # Flat, so that the stride of a Gaussian is a constant for LLVM.
    flat_means, flat_scales, flat_quats = means.reshape(-1), log_scales.reshape(-1), quats.reshape(-1)
    basis = (degree + 1) * (degree + 1)
    at = first
    for start in range(first, end, CHUNK):
        stop = min(start + CHUNK, end)
        count = _gather_seen(start, stop, flat_means, flat_scales, flat_quats, opacity_logits, view, seen, planes)
        if count == 0:
            continue
        splats_of(view, planes)
        if degree > 0:
            harmonics_of(view, planes)
        else:
            planes[BASIS * CHUNK : (BASIS + 1) * CHUNK] = _F(harmonics.DC)
        ahead = _F(0)
        for i in range(count):
            # Loads all cache lines of the coefficients at once, so that they are waited for together.
            if planes[25 * CHUNK + i] == _ONE:
                for k in range(0, basis, 5):
                    ahead += sh[seen[i], k, 0]
        planes[PLANES * CHUNK] = ahead  # stored, so that the loads are not removed
        for i in range(count):
            if planes[25 * CHUNK + i] != _ONE:
                continue
            row = splats[at]
            row[X], row[Y] = planes[12 * CHUNK + i], planes[13 * CHUNK + i]
            row[CONIC_A], row[CONIC_B], row[CONIC_C] = (
                planes[14 * CHUNK + i],
                planes[15 * CHUNK + i],
                planes[16 * CHUNK + i],
            )
            row[LOG_OPACITY], row[OPACITY] = planes[17 * CHUNK + i], planes[18 * CHUNK + i]
            row[HALF_WIDTH], row[HALF_HEIGHT], row[DEPTH] = (
                planes[19 * CHUNK + i],
                planes[20 * CHUNK + i],
                planes[21 * CHUNK + i],
            )
            touched = 0
            low, high, left, right = tile_box(row, columns, lines)
            exact = high - low > 1 and right - left > 1  # otherwise the box is exact
            for line in range(low, high):
                begin, past = left, right
                if exact:
                    begin, past = tile_columns(row, line, left, right)
                for tile in range(line * columns + begin, line * columns + past):
                    if wanted[tile]:
                        counts[tile] += 1
                        touched += 1
            if touched == 0:
                continue
            row[NORMAL], row[NORMAL + 1], row[NORMAL + 2] = (
                planes[22 * CHUNK + i],
                planes[23 * CHUNK + i],
                planes[24 * CHUNK + i],
            )
            g = seen[i]
            _write_color(row, sh[g], basis, planes, i, g, features, matrix)
            ids[at] = g
            at += 1
    visible[block] = at - first


@njit(parallel=True, cache=True, nogil=True)
def project(
    means: Float32,  # (N, 3) meters, world
    log_scales: Float32,  # (N, 3) natural logarithm of the standard deviations in meters
    quats: Float32,  # (N, 4) w x y z, of any length, from the Gaussian's axes to the world
    opacity_logits: Float32,  # (N,)
    sh: Float32,  # (N, K, 3) coefficients of the color, K = (its degree + 1)^2
    features: Float32,  # (N, F), or (0, F) if nothing is added to the color
    matrix: Float32,  # (3, F), whose product with a row of features is added to coefficient 0 of sh
    degree: int,  # up to which sh is evaluated, 0 to 3
    view: Float32,  # (33,) the camera, see `kernel_types.pack` and `limit`
    wanted: Mask,  # (tiles,) requested tiles, row by row
    blocks: int,  # equal runs of the Gaussians, one task each
    splats: Float32,  # (N, 16) out: columns as in render.layout
    ids: Int32,  # (N,) out: the Gaussian of each row of splats
    visible: Int32,  # (blocks,) out: number of rows of each block
    tile_counts: Int32,  # (blocks, tiles) out: number of rows of the block that touch each tile
) -> None:
    """Projects the visible Gaussians to `splats` (N, 16). Each of `blocks` blocks processes an equal run of the
    Gaussians and writes its visible ones to the start of that run."""
    for block in prange(blocks):
        _project_part(
            block,
            means,
            log_scales,
            quats,
            opacity_logits,
            sh,
            features,
            matrix,
            degree,
            view,
            wanted,
            blocks,
            splats,
            ids,
            visible,
            tile_counts,
        )
