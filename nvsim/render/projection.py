"""World Gaussians to splats on the image: EWA projection, opacity compensation, colour from spherical harmonics.

Forward of equations 3 to 5 of Kerbl et al. 2023, with the local affine approximation of Zwicker et al. 2001 and the
opacity compensation of Yu et al. 2024 (Mip-Splatting): rho = sqrt(det S / det (S + eps I)).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from nvsim.render.arithmetic import FLAGS, LN2, LOG2E, exp2, log2
from nvsim.render.ewa import axes_in_camera, determinant, jacobian, rotation, sh_terms, to_camera
from nvsim.render.layout import (
    BLUE,
    CONIC_A,
    CONIC_B,
    CONIC_C,
    DEPTH,
    GREEN,
    HALF_HEIGHT,
    HALF_WIDTH,
    LOG_CUT,
    LOG_OPACITY,
    NORMAL,
    OPACITY,
    RED,
    TILE,
    X,
    Y,
)
from nvsim.render.spans import tile_box, tile_columns
from nvsim.splats import harmonics

_F = np.float32
_ONE, _TWO, _HALF = _F(1), _F(2), _F(0.5)
_MOST_REACH = _F(math.sqrt(2 * math.log(255)))  # standard deviations at which alpha 1 has fallen to 1/255


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _write_colour(row: Any, sh: Any, count: Any, planes: Any, i: Any) -> None:
    red = green = blue = _HALF
    for k in range(count):
        value = planes[(_BASIS + k) * _CHUNK + i]
        red += value * sh[k, 0]
        green += value * sh[k, 1]
        blue += value * sh[k, 2]
    row[RED], row[GREEN], row[BLUE] = max(red, _F(0)), max(green, _F(0)), max(blue, _F(0))


_CHUNK = 64
# Gaussians at a time: their planes stay in the nearest cache. The loops always run over all of them, because what LLVM
# does after the last whole vector is rounded in another way.
_PLANES, _BASIS = 42, 26
# In: x, y, z in the camera's frame, whether near; log scales (3), quaternion (4), opacity logit. Out, from 12 on: u, v,
# conic (3), log opacity, opacity, half width and height, depth, normal (3), whether drawn; from _BASIS on the harmonics
# of the direction. One buffer at constant distances, so that LLVM sees that the planes do not overlap.


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _gather_seen(
    first: Any,
    end: Any,
    means: Any,
    log_scales: Any,
    quats: Any,
    opacity_logits: Any,
    view: Any,
    seen: Any,
    planes: Any,
) -> Any:
    """Numbers of the Gaussians of [first, end) that may be in view, into `seen`, and their parameters into `planes`.
    Most Gaussians are out of view, which the largest scale and the greatest reach tell at little cost."""
    for i in range(end - first):
        g = 3 * (first + i)
        planes[12 * _CHUNK + i], planes[13 * _CHUNK + i], planes[14 * _CHUNK + i] = means[g], means[g + 1], means[g + 2]
        planes[15 * _CHUNK + i] = max(log_scales[g], max(log_scales[g + 1], log_scales[g + 2]))
    for i in range(_CHUNK):
        wx, wy, wz = planes[12 * _CHUNK + i], planes[13 * _CHUNK + i], planes[14 * _CHUNK + i]
        x, y, z = to_camera(view, wx, wy, wz)
        x, y, z = x + view[9], y + view[10], z + view[11]
        iz = _ONE / z
        u, v = view[12] * x * iz + view[14] - _HALF, view[13] * y * iz + view[15] - _HALF
        widest = min(max(LOG2E * planes[15 * _CHUNK + i], _F(-30)), _F(30))
        stretch = exp2(widest) * iz * max(view[12], view[13]) * view[28]
        most = _MOST_REACH * math.sqrt(stretch * stretch + view[25])
        across = u + most > view[29] and u - most < view[30]
        along = v + most > view[31] and v - most < view[32]
        planes[i], planes[_CHUNK + i], planes[2 * _CHUNK + i] = x, y, z
        planes[3 * _CHUNK + i] = _ONE if (z > view[27] and z < _F(1e6) and across and along) else _F(0)
    count = 0
    for i in range(end - first):
        if planes[3 * _CHUNK + i] != _ONE:
            continue
        g = first + i
        seen[count] = g
        # Never ahead of i, so that what is still to be read stays.
        planes[count], planes[_CHUNK + count], planes[2 * _CHUNK + count] = (
            planes[i],
            planes[_CHUNK + i],
            planes[2 * _CHUNK + i],
        )
        planes[4 * _CHUNK + count], planes[5 * _CHUNK + count], planes[6 * _CHUNK + count] = (
            log_scales[3 * g],
            log_scales[3 * g + 1],
            log_scales[3 * g + 2],
        )
        planes[7 * _CHUNK + count], planes[8 * _CHUNK + count] = quats[4 * g], quats[4 * g + 1]
        planes[9 * _CHUNK + count], planes[10 * _CHUNK + count] = quats[4 * g + 2], quats[4 * g + 3]
        planes[11 * _CHUNK + count] = opacity_logits[g]
        count += 1
    return count


# No "nnan" among the flags: comparisons must fail for a Gaussian that is not finite, so that it is skipped.
@njit(fastmath=FLAGS, error_model="numpy")
def _splats_of(count: Any, view: Any, planes: Any) -> None:
    """One plain loop over planes, without branches, so that LLVM makes vectors of it."""
    eps = view[25]
    for i in range(_CHUNK):
        x, y, z = planes[i], planes[_CHUNK + i], planes[2 * _CHUNK + i]
        s0 = exp2(min(max(LOG2E * planes[4 * _CHUNK + i], _F(-30)), _F(30)))
        s1 = exp2(min(max(LOG2E * planes[5 * _CHUNK + i], _F(-30)), _F(30)))
        s2 = exp2(min(max(LOG2E * planes[6 * _CHUNK + i], _F(-30)), _F(30)))
        qw, qx, qy, qz = (
            planes[7 * _CHUNK + i],
            planes[8 * _CHUNK + i],
            planes[9 * _CHUNK + i],
            planes[10 * _CHUNK + i],
        )
        length = qw * qw + qx * qx + qy * qy + qz * qz
        iq = _ONE / math.sqrt(length)
        r = rotation(qw * iq, qx * iq, qy * iq, qz * iq)
        a, b, c = axes_in_camera(view, r, s0, s1, s2)
        ju, juz, jv, jvz = jacobian(view, x, y, z)
        p = (ju * a[0] + juz * a[2], ju * b[0] + juz * b[2], ju * c[0] + juz * c[2])
        s = (jv * a[1] + jvz * a[2], jv * b[1] + jvz * b[2], jv * c[1] + jvz * c[2])
        var_x, var_y = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], s[0] * s[0] + s[1] * s[1] + s[2] * s[2]
        cov = p[0] * s[0] + p[1] * s[1] + p[2] * s[2]
        thin = determinant(p, s)
        wide = thin + eps * (var_x + var_y) + eps * eps
        sigmoid = _ONE / (_ONE + exp2(min(max(-LOG2E * planes[11 * _CHUNK + i], _F(-60)), _F(60))))
        share = math.sqrt(thin / wide) if view[26] > _HALF else _ONE
        opacity = sigmoid * share
        iz = _ONE / z
        u, v = view[12] * x * iz + view[14] - _HALF, view[13] * y * iz + view[15] - _HALF
        log_opacity = log2(max(opacity, _F(1e-6)))
        reach = math.sqrt(max(_TWO * LN2 * (log_opacity - LOG_CUT), _F(0)))
        half_width, half_height = reach * math.sqrt(var_x + eps), reach * math.sqrt(var_y + eps)
        scale = -_HALF * LOG2E / wide
        planes[12 * _CHUNK + i], planes[13 * _CHUNK + i] = u, v
        planes[14 * _CHUNK + i], planes[15 * _CHUNK + i], planes[16 * _CHUNK + i] = (
            scale * (var_y + eps),
            -_TWO * scale * cov,
            scale * (var_x + eps),
        )
        planes[17 * _CHUNK + i], planes[18 * _CHUNK + i] = log_opacity, opacity
        planes[19 * _CHUNK + i], planes[20 * _CHUNK + i], planes[21 * _CHUNK + i] = half_width, half_height, z
        # The shortest axis, turned towards the eye.
        first = s0 <= s1 and s0 <= s2
        second = s1 <= s2
        nx = r[0] if first else (r[1] if second else r[2])
        ny = r[3] if first else (r[4] if second else r[5])
        nz = r[6] if first else (r[7] if second else r[8])
        cx, cy, cz = to_camera(view, nx, ny, nz)
        sign = -_ONE if cx * x + cy * y + cz * z > _F(0) else _ONE
        planes[22 * _CHUNK + i], planes[23 * _CHUNK + i], planes[24 * _CHUNK + i] = sign * nx, sign * ny, sign * nz
        drawn = sigmoid * _F(255) > _ONE and opacity * _F(255) > _ONE and length > _F(1e-20) and wide < _F(1e18)
        across = u + half_width > view[29] and u - half_width < view[30]
        along = v + half_height > view[31] and v - half_height < view[32]
        planes[25 * _CHUNK + i] = _ONE if (drawn and across and along) else _F(0)


@njit(fastmath=FLAGS, error_model="numpy")
def _harmonics_of(count: Any, view: Any, planes: Any) -> None:
    """Likewise: the harmonics of the directions from the eye to the Gaussians."""
    for i in range(_CHUNK):
        x, y, z = planes[i], planes[_CHUNK + i], planes[2 * _CHUNK + i]
        inverse = _ONE / math.sqrt(x * x + y * y + z * z)
        dx = (view[0] * x + view[3] * y + view[6] * z) * inverse
        dy = (view[1] * x + view[4] * y + view[7] * z) * inverse
        dz = (view[2] * x + view[5] * y + view[8] * z) * inverse
        values = sh_terms(dx, dy, dz)
        planes[(_BASIS + 0) * _CHUNK + i] = values[0]
        planes[(_BASIS + 1) * _CHUNK + i] = values[1]
        planes[(_BASIS + 2) * _CHUNK + i] = values[2]
        planes[(_BASIS + 3) * _CHUNK + i] = values[3]
        planes[(_BASIS + 4) * _CHUNK + i] = values[4]
        planes[(_BASIS + 5) * _CHUNK + i] = values[5]
        planes[(_BASIS + 6) * _CHUNK + i] = values[6]
        planes[(_BASIS + 7) * _CHUNK + i] = values[7]
        planes[(_BASIS + 8) * _CHUNK + i] = values[8]
        planes[(_BASIS + 9) * _CHUNK + i] = values[9]
        planes[(_BASIS + 10) * _CHUNK + i] = values[10]
        planes[(_BASIS + 11) * _CHUNK + i] = values[11]
        planes[(_BASIS + 12) * _CHUNK + i] = values[12]
        planes[(_BASIS + 13) * _CHUNK + i] = values[13]
        planes[(_BASIS + 14) * _CHUNK + i] = values[14]
        planes[(_BASIS + 15) * _CHUNK + i] = values[15]


@njit(fastmath=FLAGS, error_model="numpy")
def _project_part(
    block: Any,
    means: Any,
    log_scales: Any,
    quats: Any,
    opacity_logits: Any,
    sh: Any,
    degree: Any,
    view: Any,
    wanted: Any,
    blocks: Any,
    splats: Any,
    ids: Any,
    visible: Any,
    tile_counts: Any,
) -> None:
    n = means.shape[0]
    columns = (np.int64(view[16]) + TILE - 1) // TILE
    lines = (np.int64(view[17]) + TILE - 1) // TILE
    first, end = n * block // blocks, n * (block + 1) // blocks
    counts = tile_counts[block]
    counts[:] = 0
    seen = np.empty(_CHUNK, np.int64)
    planes = np.empty(_PLANES * _CHUNK + 1, np.float32)
    # Flat, so that the distance from one Gaussian to the next is a constant to LLVM.
    flat_means, flat_scales, flat_quats = means.reshape(-1), log_scales.reshape(-1), quats.reshape(-1)
    basis = (degree + 1) * (degree + 1)
    at = first
    for start in range(first, end, _CHUNK):
        stop = min(start + _CHUNK, end)
        count = _gather_seen(start, stop, flat_means, flat_scales, flat_quats, opacity_logits, view, seen, planes)
        if count == 0:
            continue
        _splats_of(count, view, planes)
        if degree > 0:
            _harmonics_of(count, view, planes)
        else:
            planes[_BASIS * _CHUNK : (_BASIS + 1) * _CHUNK] = _F(harmonics.DC)
        ahead = _F(0)
        for i in range(count):
            # All cache lines of the coefficients at once: waited for together, not one after the other below.
            if planes[25 * _CHUNK + i] == _ONE:
                for k in range(0, basis, 5):
                    ahead += sh[seen[i], k, 0]
        planes[_PLANES * _CHUNK] = ahead  # kept, so that the loads are
        for i in range(count):
            if planes[25 * _CHUNK + i] != _ONE:
                continue
            row = splats[at]
            row[X], row[Y] = planes[12 * _CHUNK + i], planes[13 * _CHUNK + i]
            row[CONIC_A], row[CONIC_B], row[CONIC_C] = (
                planes[14 * _CHUNK + i],
                planes[15 * _CHUNK + i],
                planes[16 * _CHUNK + i],
            )
            row[LOG_OPACITY], row[OPACITY] = planes[17 * _CHUNK + i], planes[18 * _CHUNK + i]
            row[HALF_WIDTH], row[HALF_HEIGHT], row[DEPTH] = (
                planes[19 * _CHUNK + i],
                planes[20 * _CHUNK + i],
                planes[21 * _CHUNK + i],
            )
            touched = 0
            low, high, left, right = tile_box(row, columns, lines)
            exact = high - low > 1 and right - left > 1  # otherwise the box says it all
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
                planes[22 * _CHUNK + i],
                planes[23 * _CHUNK + i],
                planes[24 * _CHUNK + i],
            )
            g = seen[i]
            _write_colour(row, sh[g], basis, planes, i)
            ids[at] = g
            at += 1
    visible[block] = at - first


@njit(parallel=True, cache=True, nogil=True)
def project(
    means: Any,
    log_scales: Any,
    quats: Any,
    opacity_logits: Any,
    sh: Any,
    degree: Any,
    view: Any,
    wanted: Any,
    blocks: Any,
    splats: Any,
    ids: Any,
    visible: Any,
    tile_counts: Any,
) -> None:
    """Projects what the camera sees. Block b of `blocks` takes an equal run of the Gaussians and packs its visible
    ones to the start of that run.

    means .. sh   as in splats.types.Gaussians; `degree` of sh is evaluated
    view          see view.pack and view.limit
    wanted        (tiles,) bool, the tiles that are to be drawn, rows of tiles after each other
    splats        out (N, 16), columns as in render.layout
    ids           out (N,) int32, which Gaussian a row of splats is
    visible       out (blocks,) int32, number of rows of each block
    tile_counts   out (blocks, tiles) int32, number of rows of the block that touch each tile
    """
    for block in prange(blocks):
        _project_part(
            block,
            means,
            log_scales,
            quats,
            opacity_logits,
            sh,
            degree,
            view,
            wanted,
            blocks,
            splats,
            ids,
            visible,
            tile_counts,
        )
