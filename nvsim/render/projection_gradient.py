"""The way back from splats to the raw parameters of the Gaussians: `projection.project` differentiated by hand.

Exact, the view direction's dependence on the centre included; zero where the forward pass clamps. Names: `d_x` is the
derivative of the loss with respect to x.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange

from nvsim.render.arithmetic import FLAGS, LOG2E, exp2
from nvsim.render.ewa import axes_in_camera, determinant, jacobian, rotation, sh_terms, to_camera
from nvsim.render.layout import BLUE, GREEN, OPACITY, RED
from nvsim.splats import harmonics

_F = np.float32
_ZERO, _ONE, _TWO, _HALF = _F(0), _F(1), _F(2), _F(0.5)

_sh_slopes = njit(forceinline=True, fastmath=FLAGS, error_model="numpy")(harmonics.slopes)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _colour_gradient(
    sh: Any, degree: Any, dx: Any, dy: Any, dz: Any, d_red: Any, d_green: Any, d_blue: Any, d_sh: Any
) -> Any:
    """Writes the gradient of the coefficients; returns that of the direction."""
    values = sh_terms(dx, dy, dz)
    slopes = _sh_slopes(dx, dy, dz)
    d_dx = d_dy = d_dz = _ZERO
    count = (degree + 1) * (degree + 1)
    for k in range(16):
        if k >= count:
            break
        d_sh[k, 0], d_sh[k, 1], d_sh[k, 2] = values[k] * d_red, values[k] * d_green, values[k] * d_blue
        d_value = sh[k, 0] * d_red + sh[k, 1] * d_green + sh[k, 2] * d_blue
        d_dx += d_value * slopes[k][0]
        d_dy += d_value * slopes[k][1]
        d_dz += d_value * slopes[k][2]
    for k in range(count, sh.shape[0]):
        d_sh[k, 0] = d_sh[k, 1] = d_sh[k, 2] = _ZERO
    return d_dx, d_dy, d_dz


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _quaternion_gradient(w: Any, x: Any, y: Any, z: Any, r: Any) -> Any:
    """Gradient of the unit quaternion from that of the rotation's nine entries `r`."""
    return (
        _TWO * (x * (r[7] - r[5]) + y * (r[2] - r[6]) + z * (r[3] - r[1])),
        _TWO * (w * (r[7] - r[5]) + y * (r[1] + r[3]) + z * (r[2] + r[6]) - _TWO * x * (r[4] + r[8])),
        _TWO * (w * (r[2] - r[6]) + x * (r[1] + r[3]) + z * (r[5] + r[7]) - _TWO * y * (r[0] + r[8])),
        _TWO * (w * (r[3] - r[1]) + x * (r[2] + r[6]) + y * (r[5] + r[7]) - _TWO * z * (r[0] + r[4])),
    )


@njit(fastmath=FLAGS, error_model="numpy")
def _project_gradient_part(
    block: Any,
    means: Any,
    log_scales: Any,
    quats: Any,
    opacity_logits: Any,
    sh: Any,
    degree: Any,
    view: Any,
    blocks: Any,
    splats: Any,
    ids: Any,
    visible: Any,
    gradients: Any,
    d_means: Any,
    d_log_scales: Any,
    d_quats: Any,
    d_opacity_logits: Any,
    d_sh: Any,
    statistics: Any,
) -> None:
    n = means.shape[0]
    longer = max(view[16], view[17])
    first, end = n * block // blocks, n * (block + 1) // blocks
    at, past = first, first + visible[block]
    for g in range(first, end):
        if at >= past or ids[at] != g:
            d_means[g, :] = _ZERO
            d_log_scales[g, :] = _ZERO
            d_quats[g, :] = _ZERO
            d_opacity_logits[g] = _ZERO
            d_sh[g, :, :] = _ZERO
            continue
        d_red = d_green = d_blue = d_depth = d_u = d_v = _ZERO
        d_a = d_b = d_c = d_opacity = abs_u = abs_v = _ZERO
        for thread in range(gradients.shape[0]):
            row = gradients[thread, at]
            d_red, d_green, d_blue, d_depth = d_red + row[0], d_green + row[1], d_blue + row[2], d_depth + row[3]
            d_u, d_v = d_u + row[4], d_v + row[5]
            d_a, d_b, d_c, d_opacity = d_a + row[6], d_b + row[7], d_c + row[8], d_opacity + row[9]
            abs_u, abs_v = abs_u + row[10], abs_v + row[11]
        splat = splats[at]
        at += 1

        # The forward pass again, as far as it is needed.
        wx, wy, wz = means[g, 0], means[g, 1], means[g, 2]
        x, y, z = to_camera(view, wx, wy, wz)
        x, y, z = x + view[9], y + view[10], z + view[11]
        s0 = exp2(min(max(LOG2E * log_scales[g, 0], _F(-30)), _F(30)))
        s1 = exp2(min(max(LOG2E * log_scales[g, 1], _F(-30)), _F(30)))
        s2 = exp2(min(max(LOG2E * log_scales[g, 2], _F(-30)), _F(30)))
        qw, qx, qy, qz = quats[g, 0], quats[g, 1], quats[g, 2], quats[g, 3]
        iq = _ONE / math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw * iq, qx * iq, qy * iq, qz * iq
        r = rotation(qw, qx, qy, qz)
        a, b, c = axes_in_camera(view, r, s0, s1, s2)
        ju, juz, jv, jvz = jacobian(view, x, y, z)
        p = (ju * a[0] + juz * a[2], ju * b[0] + juz * b[2], ju * c[0] + juz * c[2])
        s = (jv * a[1] + jvz * a[2], jv * b[1] + jvz * b[2], jv * c[1] + jvz * c[2])
        eps = view[25]
        var_x, var_y = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], s[0] * s[0] + s[1] * s[1] + s[2] * s[2]
        cov = p[0] * s[0] + p[1] * s[1] + p[2] * s[2]
        thin = determinant(p, s)
        wide = thin + eps * (var_x + var_y) + eps * eps

        # Conic Q = (S + eps I)^-1, so dS = -Q dQ Q; the off-diagonal of dQ is half of d_b, that of dS half of d_cov.
        iw = _ONE / wide
        q0, q1, q2 = (var_y + eps) * iw, -cov * iw, (var_x + eps) * iw
        half_b = _HALF * d_b
        h00, h01 = q0 * d_a + q1 * half_b, q0 * half_b + q1 * d_c
        h10, h11 = q1 * d_a + q2 * half_b, q1 * half_b + q2 * d_c
        d_var_x = -(h00 * q0 + h01 * q1)
        d_cov = -_TWO * (h00 * q1 + h01 * q2)
        d_var_y = -(h10 * q1 + h11 * q2)

        # Opacity = sigmoid * rho, with 2 d ln rho = d ln thin - d ln wide.
        sigmoid = _ONE / (_ONE + exp2(min(max(-LOG2E * opacity_logits[g], _F(-60)), _F(60))))
        pull = d_opacity * splat[OPACITY]
        d_opacity_logits[g] = pull * (_ONE - sigmoid)
        if view[26] > _HALF:
            it = _ONE / thin
            d_var_x += _HALF * pull * (var_y * it - q0)
            d_var_y += _HALF * pull * (var_x * it - q2)
            d_cov += pull * (cov * iw - cov * it)

        # S = M M^T with rows p and s of M = J (W R S).
        d_p0, d_p1, d_p2 = (
            _TWO * d_var_x * p[0] + d_cov * s[0],
            _TWO * d_var_x * p[1] + d_cov * s[1],
            _TWO * d_var_x * p[2] + d_cov * s[2],
        )
        d_s0, d_s1, d_s2 = (
            _TWO * d_var_y * s[0] + d_cov * p[0],
            _TWO * d_var_y * s[1] + d_cov * p[1],
            _TWO * d_var_y * s[2] + d_cov * p[2],
        )
        d_ju = d_p0 * a[0] + d_p1 * b[0] + d_p2 * c[0]
        d_juz = d_p0 * a[2] + d_p1 * b[2] + d_p2 * c[2]
        d_jv = d_s0 * a[1] + d_s1 * b[1] + d_s2 * c[1]
        d_jvz = d_s0 * a[2] + d_s1 * b[2] + d_s2 * c[2]
        a_x, a_y, a_z = ju * d_p0, jv * d_s0, juz * d_p0 + jvz * d_s0
        b_x, b_y, b_z = ju * d_p1, jv * d_s1, juz * d_p1 + jvz * d_s1
        c_x, c_y, c_z = ju * d_p2, jv * d_s2, juz * d_p2 + jvz * d_s2
        d_log_scales[g, 0] = a_x * a[0] + a_y * a[1] + a_z * a[2]
        d_log_scales[g, 1] = b_x * b[0] + b_y * b[1] + b_z * b[2]
        d_log_scales[g, 2] = c_x * c[0] + c_y * c[1] + c_z * c[2]

        # Back through W: the gradient of column k of R is s_k W^T (gradient of the axis).
        d_r = (
            s0 * (view[0] * a_x + view[3] * a_y + view[6] * a_z),
            s1 * (view[0] * b_x + view[3] * b_y + view[6] * b_z),
            s2 * (view[0] * c_x + view[3] * c_y + view[6] * c_z),
            s0 * (view[1] * a_x + view[4] * a_y + view[7] * a_z),
            s1 * (view[1] * b_x + view[4] * b_y + view[7] * b_z),
            s2 * (view[1] * c_x + view[4] * c_y + view[7] * c_z),
            s0 * (view[2] * a_x + view[5] * a_y + view[8] * a_z),
            s1 * (view[2] * b_x + view[5] * b_y + view[8] * b_z),
            s2 * (view[2] * c_x + view[5] * c_y + view[8] * c_z),
        )
        d_qw, d_qx, d_qy, d_qz = _quaternion_gradient(qw, qx, qy, qz, d_r)
        along = d_qw * qw + d_qx * qx + d_qy * qy + d_qz * qz
        d_quats[g, 0], d_quats[g, 1] = (d_qw - along * qw) * iq, (d_qx - along * qx) * iq
        d_quats[g, 2], d_quats[g, 3] = (d_qy - along * qy) * iq, (d_qz - along * qz) * iq

        # The camera-frame centre: through the pixel, the depth, and J (whose slopes are constant where clamped).
        iz = _ONE / z
        slope_x, slope_y = x * iz, y * iz
        d_x, d_y = d_u * view[12] * iz, d_v * view[13] * iz
        d_z = d_depth - d_x * slope_x - d_y * slope_y - (d_ju * ju + d_jv * jv) * iz
        if view[18] <= slope_x <= view[19]:
            d_x -= d_juz * view[12] * iz * iz
            d_z -= _TWO * d_juz * juz * iz
        else:
            d_z -= d_juz * juz * iz
        if view[20] <= slope_y <= view[21]:
            d_y -= d_jvz * view[13] * iz * iz
            d_z -= _TWO * d_jvz * jvz * iz
        else:
            d_z -= d_jvz * jvz * iz

        # Colour: nothing comes back through a channel that was clamped at zero.
        d_red = d_red if splat[RED] > _ZERO else _ZERO
        d_green = d_green if splat[GREEN] > _ZERO else _ZERO
        d_blue = d_blue if splat[BLUE] > _ZERO else _ZERO
        dx, dy, dz = wx - view[22], wy - view[23], wz - view[24]
        inverse = _ONE / math.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx * inverse, dy * inverse, dz * inverse
        t_x, t_y, t_z = _colour_gradient(sh[g], degree, dx, dy, dz, d_red, d_green, d_blue, d_sh[g])
        along = t_x * dx + t_y * dy + t_z * dz
        d_means[g, 0] = view[0] * d_x + view[3] * d_y + view[6] * d_z + (t_x - along * dx) * inverse
        d_means[g, 1] = view[1] * d_x + view[4] * d_y + view[7] * d_z + (t_y - along * dy) * inverse
        d_means[g, 2] = view[2] * d_x + view[5] * d_y + view[8] * d_z + (t_z - along * dz) * inverse

        if statistics.shape[0] > 0:
            half = _HALF * (var_x - var_y)
            largest = _HALF * (var_x + var_y) + eps + math.sqrt(half * half + cov * cov)
            statistics[g, 0] += _HALF * longer * math.sqrt(abs_u * abs_u + abs_v * abs_v)
            statistics[g, 1] += _ONE
            statistics[g, 2] = max(statistics[g, 2], _F(3) * math.sqrt(largest) / longer)


@njit(parallel=True, cache=True, nogil=True)
def project_gradient(
    means: Any,
    log_scales: Any,
    quats: Any,
    opacity_logits: Any,
    sh: Any,
    degree: Any,
    view: Any,
    blocks: Any,
    splats: Any,
    ids: Any,
    visible: Any,
    gradients: Any,
    d_means: Any,
    d_log_scales: Any,
    d_quats: Any,
    d_opacity_logits: Any,
    d_sh: Any,
    statistics: Any,
) -> None:
    """First arguments as in `projection.project`, `gradients` from `raster_gradient.draw_gradient`. Every row of the
    outputs d_* is written, zero for Gaussians that were not drawn. statistics: (N, 3), to which every drawn Gaussian
    adds as training asks (see autograd.Statistics), or (0, 3)."""
    for block in prange(blocks):
        _project_gradient_part(
            block,
            means,
            log_scales,
            quats,
            opacity_logits,
            sh,
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
            statistics,
        )
