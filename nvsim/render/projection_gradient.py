"""Gradients of the raw parameters of the Gaussians from those of the splats: the adjoint of `projection.project`. The
geometry is in `chunk_gradient`; this module has the colors and the transfer of all values between rows and planes."""

from __future__ import annotations

import numpy as np

from nvsim.kernels import njit, prange
from nvsim.render.arithmetic import FLAGS
from nvsim.render.chunk import BASIS, CHUNK, harmonics_of
from nvsim.render.chunk_gradient import (
    BY_HARMONIC,
    D_LOGIT,
    D_MEANS,
    D_QUATS,
    D_SCALES,
    EXTENT,
    GIVEN,
    OPACITY,
    PLANES,
    SHIFT,
    add_direction_gradient,
    gradients_of,
    to_camera_frame,
)
from nvsim.render.kernel_types import BLUE, GREEN, RED, Float32, Int32
from nvsim.render.kernel_types import OPACITY as SPLAT_OPACITY
from nvsim.splats import harmonics

_F = np.float32
_ZERO, _ONE, _DC = _F(0), _F(1), _F(harmonics.DC)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _write_parameters(
    at: int,  # row of splats
    count: int,  # rows, at most CHUNK
    means: Float32,  # (3 N,) meters, world
    log_scales: Float32,  # (3 N,) natural logarithm of meters
    quats: Float32,  # (4 N,) w x y z
    opacity_logits: Float32,  # (N,)
    splats: Float32,  # (N, 16) columns as in render.layout
    ids: Int32,  # (N,) the Gaussian of each row of splats
    gradients: Float32,  # (threads, N or more, 12) of `raster_gradient.draw_gradient`
    planes: Float32,  # (PLANES * CHUNK,) out, as in `chunk_gradient`
    colors: Float32,  # (CHUNK, 3) out
) -> None:
    """Writes the parameters of the Gaussians of the rows from `at` on, and the gradients of their splats, summed over
    the threads, to `planes`; those of the colors to `colors`."""
    for i in range(count):
        g, row, splat = np.int64(ids[at + i]), gradients[0, at + i], splats[at + i]
        red, green, blue, depth, u, v = row[0], row[1], row[2], row[3], row[4], row[5]
        a, b, c, opacity, abs_u, abs_v = row[6], row[7], row[8], row[9], row[10], row[11]
        for thread in range(1, gradients.shape[0]):
            row = gradients[thread, at + i]
            red, green, blue, depth, u, v = (
                red + row[0],
                green + row[1],
                blue + row[2],
                depth + row[3],
                u + row[4],
                v + row[5],
            )
            a, b, c, opacity, abs_u, abs_v = (
                a + row[6],
                b + row[7],
                c + row[8],
                opacity + row[9],
                abs_u + row[10],
                abs_v + row[11],
            )
        # A channel that was clamped at zero has no gradient.
        colors[i, 0] = red if splat[RED] > _ZERO else _ZERO
        colors[i, 1] = green if splat[GREEN] > _ZERO else _ZERO
        colors[i, 2] = blue if splat[BLUE] > _ZERO else _ZERO
        planes[(GIVEN + 0) * CHUNK + i], planes[(GIVEN + 1) * CHUNK + i], planes[(GIVEN + 2) * CHUNK + i] = depth, u, v
        planes[(GIVEN + 3) * CHUNK + i], planes[(GIVEN + 4) * CHUNK + i], planes[(GIVEN + 5) * CHUNK + i] = a, b, c
        planes[(GIVEN + 6) * CHUNK + i] = opacity
        planes[(GIVEN + 7) * CHUNK + i], planes[(GIVEN + 8) * CHUNK + i] = abs_u, abs_v
        planes[OPACITY * CHUNK + i] = splat[SPLAT_OPACITY]
        for k in range(3):
            planes[k * CHUNK + i] = means[3 * g + k]
        for k in range(3):
            planes[(4 + k) * CHUNK + i] = log_scales[3 * g + k]
        for k in range(4):
            planes[(7 + k) * CHUNK + i] = quats[4 * g + k]
        planes[11 * CHUNK + i] = opacity_logits[g]


@njit(fastmath=FLAGS, error_model="numpy")
def _tint_gradients(
    at: int,  # row of splats
    count: int,  # rows, at most CHUNK
    ids: Int32,  # (N,) the Gaussian of each row of splats
    features: Float32,  # (N, F)
    matrix: Float32,  # (3, F)
    colors: Float32,  # (CHUNK, 3) gradient by the colors
    d_features: Float32,  # (N, F) out
    d_matrix: Float32,  # (3, F) changed
) -> None:
    """Gradients of the features from those of the colors; those of the matrix are added to d_matrix."""
    for i in range(count):
        own, to = features[ids[at + i]], d_features[ids[at + i]]
        red, green, blue = _DC * colors[i, 0], _DC * colors[i, 1], _DC * colors[i, 2]
        for f in range(own.shape[0]):
            value = own[f]
            to[f] = matrix[0, f] * red + matrix[1, f] * green + matrix[2, f] * blue
            d_matrix[0, f] += red * value
            d_matrix[1, f] += green * value
            d_matrix[2, f] += blue * value


@njit(fastmath=FLAGS, error_model="numpy")
def _color_gradients(
    at: int,  # row of splats
    count: int,  # rows, at most CHUNK
    ids: Int32,  # (N,) the Gaussian of each row of splats
    basis: int,  # number of evaluated coefficients
    sh: Float32,  # (N, K, 3)
    colors: Float32,  # (CHUNK, 3) gradient by the colors
    planes: Float32,  # (PLANES * CHUNK,) as in `chunk_gradient`; those from BY_HARMONIC on are written
    d_sh: Float32,  # (N, K, 3) out
) -> None:
    """Gradients of the coefficients from those of the colors; gradients by the harmonics are written to `planes`."""
    for i in range(count):
        own, to = sh[ids[at + i]], d_sh[ids[at + i]]
        red, green, blue = colors[i, 0], colors[i, 1], colors[i, 2]
        for k in range(basis):
            value = planes[(BASIS + k) * CHUNK + i]
            to[k, 0], to[k, 1], to[k, 2] = value * red, value * green, value * blue
            planes[(BY_HARMONIC + k) * CHUNK + i] = own[k, 0] * red + own[k, 1] * green + own[k, 2] * blue
        to[basis:] = _ZERO


@njit(fastmath=FLAGS, error_model="numpy")
def _project_gradient_part(
    block: int,
    means: Float32,  # as in `project_gradient`, like all following
    log_scales: Float32,
    quats: Float32,
    opacity_logits: Float32,
    sh: Float32,
    features: Float32,
    matrix: Float32,
    degree: int,
    view: Float32,
    blocks: int,
    splats: Float32,
    ids: Int32,
    visible: Int32,
    gradients: Float32,
    d_means: Float32,
    d_log_scales: Float32,
    d_quats: Float32,
    d_opacity_logits: Float32,
    d_sh: Float32,
    d_features: Float32,
    d_matrix: Float32,
    statistics: Float32,
) -> None:
    n, width = means.shape[0], 3 * sh.shape[1]
    first, end = n * block // blocks, n * (block + 1) // blocks
    basis = (degree + 1) * (degree + 1)
    flat_means, flat_scales, flat_quats = means.reshape(-1), log_scales.reshape(-1), quats.reshape(-1)
    to_means, to_scales, to_quats = d_means.reshape(-1), d_log_scales.reshape(-1), d_quats.reshape(-1)
    to_sh = d_sh.reshape(-1)
    planes, colors = np.zeros(PLANES * CHUNK, np.float32), np.empty((CHUNK, 3), np.float32)
    planes[BASIS * CHUNK : (BASIS + 1) * CHUNK] = _DC
    d_matrix[block] = _ZERO
    if d_features.shape[0] > 0:
        d_features[first:end] = _ZERO
    written, past = first, first + visible[block]
    for at in range(first, past, CHUNK):
        count = min(CHUNK, past - at)
        _write_parameters(
            at,
            count,
            flat_means,
            flat_scales,
            flat_quats,
            opacity_logits,
            splats,
            ids,
            gradients,
            planes,
            colors,
        )
        to_camera_frame(view, planes)
        gradients_of(view, planes)
        if degree > 0:
            harmonics_of(view, planes)
        if d_features.shape[0] > 0:
            _tint_gradients(at, count, ids, features, matrix, colors, d_features, d_matrix[block])
        _color_gradients(at, count, ids, basis, sh, colors, planes, d_sh)
        if degree > 0:
            add_direction_gradient(view, planes)
        for i in range(count):
            g = np.int64(ids[at + i])
            if written < g:
                to_sh[width * written : width * g] = _ZERO
                to_means[3 * written : 3 * g] = _ZERO
                to_scales[3 * written : 3 * g] = _ZERO
                to_quats[4 * written : 4 * g] = _ZERO
                d_opacity_logits[written:g] = _ZERO
            written = g + 1
            for k in range(3):
                to_means[3 * g + k] = planes[(D_MEANS + k) * CHUNK + i]
            for k in range(3):
                to_scales[3 * g + k] = planes[(D_SCALES + k) * CHUNK + i]
            for k in range(4):
                to_quats[4 * g + k] = planes[(D_QUATS + k) * CHUNK + i]
            d_opacity_logits[g] = planes[D_LOGIT * CHUNK + i]
            if statistics.shape[0] > 0:
                statistics[g, 0] += planes[SHIFT * CHUNK + i]
                statistics[g, 1] += _ONE
                statistics[g, 2] = max(statistics[g, 2], planes[EXTENT * CHUNK + i])
    to_sh[width * written : width * end] = _ZERO
    to_means[3 * written : 3 * end] = _ZERO
    to_scales[3 * written : 3 * end] = _ZERO
    to_quats[4 * written : 4 * end] = _ZERO
    d_opacity_logits[written:end] = _ZERO


@njit(parallel=True, cache=True, nogil=True)
def project_gradient(
    means: Float32,  # (N, 3) meters, world
    log_scales: Float32,  # (N, 3) natural logarithm of meters
    quats: Float32,  # (N, 4) w x y z
    opacity_logits: Float32,  # (N,)
    sh: Float32,  # (N, K, 3)
    features: Float32,  # (N, F) or (0, F)
    matrix: Float32,  # (3, F)
    degree: int,  # up to which sh was evaluated, 0 to 3
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    blocks: int,  # as in `projection.project`
    splats: Float32,  # (N, 16) as written by `projection.project`, like the next two
    ids: Int32,  # (N,)
    visible: Int32,  # (blocks,)
    gradients: Float32,  # (threads, N or more, 12) of `raster_gradient.draw_gradient`
    d_means: Float32,  # (N, 3) out, per meter
    d_log_scales: Float32,  # (N, 3) out
    d_quats: Float32,  # (N, 4) out
    d_opacity_logits: Float32,  # (N,) out
    d_sh: Float32,  # (N, K, 3) out
    d_features: Float32,  # (N, F) out, or (0, F)
    d_matrix: Float32,  # (blocks, 3, F) out: each block's part of the sum
    statistics: Float32,  # (N, 3) changed, or (0, 3), see autograd.Statistics
) -> None:
    """Gradients of the raw parameters from those of the splats. Arguments without explanation are those of
    `projection.project`. Every row of the outputs d_* is written, with zero for Gaussians that were not drawn. Every
    drawn Gaussian is added to `statistics` (N, 3)."""
    for block in prange(blocks):
        _project_gradient_part(
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
            blocks,
            splats,
            ids,
            visible,
            gradients,
            d_means,
            d_log_scales,
            d_quats,
            d_opacity_logits,
            d_sh,
            d_features,
            d_matrix,
            statistics,
        )
