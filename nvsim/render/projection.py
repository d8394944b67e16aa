"""World Gaussians to splats on the image: EWA projection, opacity compensation, colour from spherical harmonics.

Forward of equations 3 to 5 of Kerbl et al. 2023, with the local affine approximation of Zwicker et al. 2001 and the
opacity compensation of Yu et al. 2024 (Mip-Splatting): rho = sqrt(det S / det (S + eps I)).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.arithmetic import FLAGS, LN2, LOG2E, exp2
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
EPS2D = 0.3
"""Variance of the pixel's low-pass filter, pixels squared."""
NEAR = 0.05
"""Gaussians whose centre is nearer than this along the optical axis are not drawn, metres."""
_MOST_REACH = _F(math.sqrt(2 * math.log(255)))  # standard deviations at which alpha 1 has fallen to 1/255
_MARGIN = 0.15
# The affine approximation is taken at most this share of the image size outside it, as is the custom: farther out it
# stretches Gaussians without bound.

sh_terms = njit(forceinline=True, fastmath=FLAGS, error_model="numpy")(harmonics.terms)


def pack(camera: Camera, antialiased: bool) -> NDArray[np.float32]:
    """The camera as the (33,) float32 row that the kernels read: rotation and translation of world to camera, focal
    lengths, principal point, size, limits of x/z and y/z, eye, filter variance, whether opacity is compensated, nearest
    depth, how far the slopes can stretch a Gaussian, and the first and last pixel that is wanted, of a row and of a
    column (see `limit`)."""
    k = camera.intrinsics
    view = np.empty(33, np.float32)
    view[0:9] = camera.world_to_camera[:3, :3].reshape(-1)
    view[9:12] = camera.world_to_camera[:3, 3]
    view[12:18] = k.fx, k.fy, k.cx, k.cy, k.width, k.height
    view[18:20] = -(k.cx + _MARGIN * k.width) / k.fx, (k.width - k.cx + _MARGIN * k.width) / k.fx
    view[20:22] = -(k.cy + _MARGIN * k.height) / k.fy, (k.height - k.cy + _MARGIN * k.height) / k.fy
    view[22:25] = camera.position
    view[25:28] = EPS2D, antialiased, NEAR
    # Rows of the Jacobian are at most focal / z times this long.
    view[28] = np.sqrt(1 + max(view[18] ** 2, view[19] ** 2, view[20] ** 2, view[21] ** 2))
    view[29:33] = 0, k.width - 1, 0, k.height - 1
    return view


def limit(view: NDArray[np.float32], tiles: NDArray[np.bool_]) -> None:
    """Narrows a packed camera to the bounding box of the `tiles` (lines, columns) that are wanted."""
    lines, columns = np.flatnonzero(tiles.any(axis=1)), np.flatnonzero(tiles.any(axis=0))
    if len(lines) == 0:
        view[29:33] = 0, -1, 0, -1
        return
    view[29], view[30] = columns[0] * TILE, min(view[30], columns[-1] * TILE + TILE - 1)
    view[31], view[32] = lines[0] * TILE, min(view[32], lines[-1] * TILE + TILE - 1)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def rotation(w: Any, x: Any, y: Any, z: Any) -> Any:
    """The nine entries, by rows, of the rotation of a unit quaternion."""
    return (
        _ONE - _TWO * (y * y + z * z),
        _TWO * (x * y - w * z),
        _TWO * (x * z + w * y),
        _TWO * (x * y + w * z),
        _ONE - _TWO * (x * x + z * z),
        _TWO * (y * z - w * x),
        _TWO * (x * z - w * y),
        _TWO * (y * z + w * x),
        _ONE - _TWO * (x * x + y * y),
    )


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def to_camera(view: Any, x: Any, y: Any, z: Any) -> Any:
    """A direction of the world along the camera's axes."""
    return (
        view[0] * x + view[1] * y + view[2] * z,
        view[3] * x + view[4] * y + view[5] * z,
        view[6] * x + view[7] * y + view[8] * z,
    )


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def jacobian(view: Any, x: Any, y: Any, z: Any) -> Any:
    """Derivative of the pixel with respect to the camera-frame point: du/dx, du/dz, dv/dy, dv/dz."""
    iz = _ONE / z
    slope_x = min(max(x * iz, view[18]), view[19])
    slope_y = min(max(y * iz, view[20]), view[21])
    return view[12] * iz, -view[12] * slope_x * iz, view[13] * iz, -view[13] * slope_y * iz


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def axes_in_camera(view: Any, r: Any, s0: Any, s1: Any, s2: Any) -> Any:
    """The three semi-axes (columns of W R S) in the camera frame, by columns."""
    a = to_camera(view, r[0] * s0, r[3] * s0, r[6] * s0)
    b = to_camera(view, r[1] * s1, r[4] * s1, r[7] * s1)
    c = to_camera(view, r[2] * s2, r[5] * s2, r[8] * s2)
    return a, b, c


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def determinant(p: Any, s: Any) -> Any:
    """det(M M^T) of the 2x3 matrix with rows p and s, as the squared length of p x s (Cauchy-Binet): free of the
    cancellation that A C - B^2 suffers for thin Gaussians in single precision."""
    m0 = p[1] * s[2] - p[2] * s[1]
    m1 = p[2] * s[0] - p[0] * s[2]
    m2 = p[0] * s[1] - p[1] * s[0]
    return m0 * m0 + m1 * m1 + m2 * m2


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _write_normal(row: Any, r: Any, s0: Any, s1: Any, s2: Any, dx: Any, dy: Any, dz: Any) -> None:
    # The shortest axis, turned towards the eye; (dx, dy, dz) points from the eye to the Gaussian.
    nx, ny, nz = r[2], r[5], r[8]
    if s0 <= s1 and s0 <= s2:
        nx, ny, nz = r[0], r[3], r[6]
    elif s1 <= s2:
        nx, ny, nz = r[1], r[4], r[7]
    if nx * dx + ny * dy + nz * dz > _F(0):
        nx, ny, nz = -nx, -ny, -nz
    row[NORMAL], row[NORMAL + 1], row[NORMAL + 2] = nx, ny, nz


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _write_colour(row: Any, sh: Any, degree: Any, dx: Any, dy: Any, dz: Any) -> None:
    red = green = blue = _HALF
    values = sh_terms(dx, dy, dz)
    red += values[0] * sh[0, 0]
    green += values[0] * sh[0, 1]
    blue += values[0] * sh[0, 2]
    if degree > 0:
        for k in range(1, 4):
            red += values[k] * sh[k, 0]
            green += values[k] * sh[k, 1]
            blue += values[k] * sh[k, 2]
    if degree > 1:
        for k in range(4, 9):
            red += values[k] * sh[k, 0]
            green += values[k] * sh[k, 1]
            blue += values[k] * sh[k, 2]
    if degree > 2:
        for k in range(9, 16):
            red += values[k] * sh[k, 0]
            green += values[k] * sh[k, 1]
            blue += values[k] * sh[k, 2]
    row[RED], row[GREEN], row[BLUE] = max(red, _F(0)), max(green, _F(0)), max(blue, _F(0))


# No "nnan" among the flags: comparisons must fail for a Gaussian that is not finite, so that it is skipped.
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
    at = first
    for g in range(first, end):
        wx, wy, wz = means[g, 0], means[g, 1], means[g, 2]
        x, y, z = to_camera(view, wx, wy, wz)
        x, y, z = x + view[9], y + view[10], z + view[11]
        if not (z > view[27] and z < _F(1e6)):
            continue
        iz = _ONE / z
        slope_x, slope_y = x * iz, y * iz
        u, v = view[12] * slope_x + view[14] - _HALF, view[13] * slope_y + view[15] - _HALF
        # Most Gaussians are out of view, which the largest scale and the greatest reach tell at little cost.
        widest = max(log_scales[g, 0], max(log_scales[g, 1], log_scales[g, 2]))
        stretch = exp2(min(max(LOG2E * widest, _F(-30)), _F(30))) * iz * max(view[12], view[13]) * view[28]
        most = _MOST_REACH * math.sqrt(stretch * stretch + view[25])
        if not (u + most > view[29] and u - most < view[30] and v + most > view[31] and v - most < view[32]):
            continue
        sigmoid = _ONE / (_ONE + exp2(min(max(-LOG2E * opacity_logits[g], _F(-60)), _F(60))))
        if not (sigmoid * _F(255) > _ONE):
            continue
        s0 = exp2(min(max(LOG2E * log_scales[g, 0], _F(-30)), _F(30)))
        s1 = exp2(min(max(LOG2E * log_scales[g, 1], _F(-30)), _F(30)))
        s2 = exp2(min(max(LOG2E * log_scales[g, 2], _F(-30)), _F(30)))
        qw, qx, qy, qz = quats[g, 0], quats[g, 1], quats[g, 2], quats[g, 3]
        length = qw * qw + qx * qx + qy * qy + qz * qz
        if not (length > _F(1e-20)):
            continue
        iq = _ONE / math.sqrt(length)
        r = rotation(qw * iq, qx * iq, qy * iq, qz * iq)
        a, b, c = axes_in_camera(view, r, s0, s1, s2)
        ju, juz, jv, jvz = jacobian(view, x, y, z)
        p = (ju * a[0] + juz * a[2], ju * b[0] + juz * b[2], ju * c[0] + juz * c[2])
        s = (jv * a[1] + jvz * a[2], jv * b[1] + jvz * b[2], jv * c[1] + jvz * c[2])
        eps = view[25]
        var_x, var_y = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], s[0] * s[0] + s[1] * s[1] + s[2] * s[2]
        cov = p[0] * s[0] + p[1] * s[1] + p[2] * s[2]
        thin = determinant(p, s)
        wide = thin + eps * (var_x + var_y) + eps * eps
        opacity = sigmoid
        if view[26] > _HALF:
            opacity = sigmoid * math.sqrt(thin / wide)
        if not (opacity * _F(255) > _ONE and wide < _F(1e18)):
            continue
        log_opacity = math.log(opacity) * LOG2E
        reach = math.sqrt(_TWO * LN2 * (log_opacity - LOG_CUT))
        half_width, half_height = reach * math.sqrt(var_x + eps), reach * math.sqrt(var_y + eps)
        if not (u + half_width > view[29] and u - half_width < view[30]):
            continue
        if not (v + half_height > view[31] and v - half_height < view[32]):
            continue
        row = splats[at]
        row[X], row[Y] = u, v
        scale = -_HALF * LOG2E / wide
        row[CONIC_A] = scale * (var_y + eps)
        row[CONIC_B] = -_TWO * scale * cov
        row[CONIC_C] = scale * (var_x + eps)
        row[LOG_OPACITY], row[OPACITY] = log_opacity, opacity
        row[HALF_WIDTH], row[HALF_HEIGHT] = half_width, half_height
        row[DEPTH] = z
        touched = 0
        low, high, left, right = tile_box(row, columns, lines)
        exact = high - low > 1 and right - left > 1  # otherwise the box says it all
        for line in range(low, high):
            begin, stop = left, right
            if exact:
                begin, stop = tile_columns(row, line, left, right)
            for tile in range(line * columns + begin, line * columns + stop):
                if wanted[tile]:
                    counts[tile] += 1
                    touched += 1
        if touched == 0:
            continue
        dx, dy, dz = wx - view[22], wy - view[23], wz - view[24]
        inverse = _ONE / math.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx * inverse, dy * inverse, dz * inverse
        _write_normal(row, r, s0, s1, s2, dx, dy, dz)
        _write_colour(row, sh[g], degree, dx, dy, dz)
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
    view          see `pack` and `limit`
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
