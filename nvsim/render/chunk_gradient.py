"""Gradients of the raw parameters of a chunk of Gaussians from those of their splats, several at a time in a vector.
This is `chunk.splats_of` differentiated by hand.

The gradient is exact and includes the dependence of the view direction on the center; it is zero where the forward pass
clamps. `d_x` is the derivative of the loss with respect to x. The planes are those of `chunk`, but the splats are
replaced and followed by these:
"""

from __future__ import annotations

import math

import numpy as np

from nvsim.kernels import njit
from nvsim.render.arithmetic import FLAGS, LOG2E, exp2
from nvsim.render.chunk import BASIS, CHUNK
from nvsim.render.ewa import axes_in_camera, determinant, jacobian, rotation, to_camera
from nvsim.render.kernel_types import Float32, Matrix3, Quaternion, Vector3
from nvsim.splats import harmonics

GIVEN = 12
"""Gradients by depth, u, v, conic (3), and opacity, and the sums of absolute gradients by u and v."""
OPACITY = 21
BY_HARMONIC = BASIS + 16
"""Gradients by the 16 harmonics, from which those by the direction are computed."""
D_MEANS = BY_HARMONIC + 16
D_SCALES, D_QUATS, D_LOGIT, SHIFT, EXTENT = D_MEANS + 3, D_MEANS + 6, D_MEANS + 10, D_MEANS + 11, D_MEANS + 12
"""Output: gradients of the raw parameters; the absolute gradient of the center in halves of the image's longer side;
and three standard deviations of the splat in longer sides."""
PLANES = D_MEANS + 13
_F = np.float32
_ZERO, _ONE, _TWO, _HALF = _F(0), _F(1), _F(2), _F(0.5)

_sh_slopes = njit(forceinline=True, fastmath=FLAGS, error_model="numpy")(harmonics.basis_gradients)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def _quaternion_gradient(w: np.float32, x: np.float32, y: np.float32, z: np.float32, r: Matrix3) -> Quaternion:
    """Gradient of the unit quaternion from that of the rotation's nine entries `r`."""
    return (
        _TWO * (x * (r[7] - r[5]) + y * (r[2] - r[6]) + z * (r[3] - r[1])),
        _TWO * (w * (r[7] - r[5]) + y * (r[1] + r[3]) + z * (r[2] + r[6]) - _TWO * x * (r[4] + r[8])),
        _TWO * (w * (r[2] - r[6]) + x * (r[1] + r[3]) + z * (r[5] + r[7]) - _TWO * y * (r[0] + r[8])),
        _TWO * (w * (r[3] - r[1]) + x * (r[2] + r[6]) + y * (r[5] + r[7]) - _TWO * z * (r[0] + r[4])),
    )


@njit(fastmath=FLAGS, error_model="numpy")
def to_camera_frame(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    planes: Float32,  # (PLANES * CHUNK,) meters, changed
) -> None:
    """Transforms the centers in the first three planes from the world to the camera's frame."""
    for i in range(CHUNK):
        x, y, z = to_camera(view, planes[i], planes[CHUNK + i], planes[2 * CHUNK + i])
        planes[i], planes[CHUNK + i], planes[2 * CHUNK + i] = x + view[9], y + view[10], z + view[11]


@njit(fastmath=FLAGS, error_model="numpy")
def add_direction_gradient(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    planes: Float32,  # (PLANES * CHUNK,) reads those from BY_HARMONIC on, changes those from D_MEANS on
) -> None:
    """Adds the gradient through the view direction of a Gaussian to that of its center."""
    for i in range(CHUNK):
        x, y, z = planes[i], planes[CHUNK + i], planes[2 * CHUNK + i]
        inverse = _ONE / math.sqrt(x * x + y * y + z * z)
        dx = (view[0] * x + view[3] * y + view[6] * z) * inverse
        dy = (view[1] * x + view[4] * y + view[7] * z) * inverse
        dz = (view[2] * x + view[5] * y + view[8] * z) * inverse
        slopes: tuple[Vector3, ...] = _sh_slopes(dx, dy, dz)
        t_x = t_y = t_z = _ZERO
        d_value = planes[(BY_HARMONIC + 1) * CHUNK + i]
        t_x += d_value * slopes[1][0]
        t_y += d_value * slopes[1][1]
        t_z += d_value * slopes[1][2]
        d_value = planes[(BY_HARMONIC + 2) * CHUNK + i]
        t_x += d_value * slopes[2][0]
        t_y += d_value * slopes[2][1]
        t_z += d_value * slopes[2][2]
        d_value = planes[(BY_HARMONIC + 3) * CHUNK + i]
        t_x += d_value * slopes[3][0]
        t_y += d_value * slopes[3][1]
        t_z += d_value * slopes[3][2]
        d_value = planes[(BY_HARMONIC + 4) * CHUNK + i]
        t_x += d_value * slopes[4][0]
        t_y += d_value * slopes[4][1]
        t_z += d_value * slopes[4][2]
        d_value = planes[(BY_HARMONIC + 5) * CHUNK + i]
        t_x += d_value * slopes[5][0]
        t_y += d_value * slopes[5][1]
        t_z += d_value * slopes[5][2]
        d_value = planes[(BY_HARMONIC + 6) * CHUNK + i]
        t_x += d_value * slopes[6][0]
        t_y += d_value * slopes[6][1]
        t_z += d_value * slopes[6][2]
        d_value = planes[(BY_HARMONIC + 7) * CHUNK + i]
        t_x += d_value * slopes[7][0]
        t_y += d_value * slopes[7][1]
        t_z += d_value * slopes[7][2]
        d_value = planes[(BY_HARMONIC + 8) * CHUNK + i]
        t_x += d_value * slopes[8][0]
        t_y += d_value * slopes[8][1]
        t_z += d_value * slopes[8][2]
        d_value = planes[(BY_HARMONIC + 9) * CHUNK + i]
        t_x += d_value * slopes[9][0]
        t_y += d_value * slopes[9][1]
        t_z += d_value * slopes[9][2]
        d_value = planes[(BY_HARMONIC + 10) * CHUNK + i]
        t_x += d_value * slopes[10][0]
        t_y += d_value * slopes[10][1]
        t_z += d_value * slopes[10][2]
        d_value = planes[(BY_HARMONIC + 11) * CHUNK + i]
        t_x += d_value * slopes[11][0]
        t_y += d_value * slopes[11][1]
        t_z += d_value * slopes[11][2]
        d_value = planes[(BY_HARMONIC + 12) * CHUNK + i]
        t_x += d_value * slopes[12][0]
        t_y += d_value * slopes[12][1]
        t_z += d_value * slopes[12][2]
        d_value = planes[(BY_HARMONIC + 13) * CHUNK + i]
        t_x += d_value * slopes[13][0]
        t_y += d_value * slopes[13][1]
        t_z += d_value * slopes[13][2]
        d_value = planes[(BY_HARMONIC + 14) * CHUNK + i]
        t_x += d_value * slopes[14][0]
        t_y += d_value * slopes[14][1]
        t_z += d_value * slopes[14][2]
        d_value = planes[(BY_HARMONIC + 15) * CHUNK + i]
        t_x += d_value * slopes[15][0]
        t_y += d_value * slopes[15][1]
        t_z += d_value * slopes[15][2]
        along = t_x * dx + t_y * dy + t_z * dz
        planes[D_MEANS * CHUNK + i] += (t_x - along * dx) * inverse
        planes[(D_MEANS + 1) * CHUNK + i] += (t_y - along * dy) * inverse
        planes[(D_MEANS + 2) * CHUNK + i] += (t_z - along * dz) * inverse


@njit(fastmath=FLAGS, error_model="numpy")
def gradients_of(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    planes: Float32,  # (PLANES * CHUNK,) reads the first 12, GIVEN, and OPACITY, writes those from D_MEANS on
) -> None:
    """Gradients of the raw parameters except the color, in loops without branches."""
    eps, longer, compensated = view[25], max(view[16], view[17]), view[26] > _HALF
    for i in range(CHUNK):
        x, y, z = planes[i], planes[CHUNK + i], planes[2 * CHUNK + i]
        # The required part of the forward pass again.
        s0 = exp2(min(max(LOG2E * planes[4 * CHUNK + i], _F(-30)), _F(30)))
        s1 = exp2(min(max(LOG2E * planes[5 * CHUNK + i], _F(-30)), _F(30)))
        s2 = exp2(min(max(LOG2E * planes[6 * CHUNK + i], _F(-30)), _F(30)))
        qw, qx, qy, qz = (
            planes[7 * CHUNK + i],
            planes[8 * CHUNK + i],
            planes[9 * CHUNK + i],
            planes[10 * CHUNK + i],
        )
        iq = _ONE / math.sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
        qw, qx, qy, qz = qw * iq, qx * iq, qy * iq, qz * iq
        r = rotation(qw, qx, qy, qz)
        a, b, c = axes_in_camera(view, r, s0, s1, s2)
        ju, juz, jv, jvz = jacobian(view, x, y, z)
        p = (ju * a[0] + juz * a[2], ju * b[0] + juz * b[2], ju * c[0] + juz * c[2])
        s = (jv * a[1] + jvz * a[2], jv * b[1] + jvz * b[2], jv * c[1] + jvz * c[2])
        var_x, var_y = p[0] * p[0] + p[1] * p[1] + p[2] * p[2], s[0] * s[0] + s[1] * s[1] + s[2] * s[2]
        cov = p[0] * s[0] + p[1] * s[1] + p[2] * s[2]
        thin = determinant(p, s)
        wide = thin + eps * (var_x + var_y) + eps * eps
        d_depth = planes[(GIVEN + 0) * CHUNK + i]
        d_u = planes[(GIVEN + 1) * CHUNK + i]
        d_v = planes[(GIVEN + 2) * CHUNK + i]
        d_a = planes[(GIVEN + 3) * CHUNK + i]
        d_b = planes[(GIVEN + 4) * CHUNK + i]
        d_c = planes[(GIVEN + 5) * CHUNK + i]
        d_opacity = planes[(GIVEN + 6) * CHUNK + i]

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
        sigmoid = _ONE / (_ONE + exp2(min(max(-LOG2E * planes[11 * CHUNK + i], _F(-60)), _F(60))))
        pull = d_opacity * planes[OPACITY * CHUNK + i]
        planes[D_LOGIT * CHUNK + i] = pull * (_ONE - sigmoid)
        it, shared = _ONE / thin, pull if compensated else _ZERO
        d_var_x += _HALF * shared * (var_y * it - q0) if compensated else _ZERO
        d_var_y += _HALF * shared * (var_x * it - q2) if compensated else _ZERO
        d_cov += shared * (cov * iw - cov * it) if compensated else _ZERO

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
        planes[(D_SCALES + 0) * CHUNK + i] = a_x * a[0] + a_y * a[1] + a_z * a[2]
        planes[(D_SCALES + 1) * CHUNK + i] = b_x * b[0] + b_y * b[1] + b_z * b[2]
        planes[(D_SCALES + 2) * CHUNK + i] = c_x * c[0] + c_y * c[1] + c_z * c[2]

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
        planes[D_QUATS * CHUNK + i] = (d_qw - along * qw) * iq
        planes[(D_QUATS + 1) * CHUNK + i] = (d_qx - along * qx) * iq
        planes[(D_QUATS + 2) * CHUNK + i] = (d_qy - along * qy) * iq
        planes[(D_QUATS + 3) * CHUNK + i] = (d_qz - along * qz) * iq

        # The camera-frame center: through the pixel, the depth, and J (whose slopes are constant where clamped).
        iz = _ONE / z
        slope_x, slope_y = x * iz, y * iz
        d_x, d_y = d_u * view[12] * iz, d_v * view[13] * iz
        d_z = d_depth - d_x * slope_x - d_y * slope_y - (d_ju * ju + d_jv * jv) * iz
        free_x = _ONE if (slope_x >= view[18]) & (slope_x <= view[19]) else _ZERO
        free_y = _ONE if (slope_y >= view[20]) & (slope_y <= view[21]) else _ZERO
        d_x -= free_x * d_juz * view[12] * iz * iz
        d_y -= free_y * d_jvz * view[13] * iz * iz
        d_z -= ((_ONE + free_x) * d_juz * juz + (_ONE + free_y) * d_jvz * jvz) * iz

        planes[D_MEANS * CHUNK + i] = view[0] * d_x + view[3] * d_y + view[6] * d_z
        planes[(D_MEANS + 1) * CHUNK + i] = view[1] * d_x + view[4] * d_y + view[7] * d_z
        planes[(D_MEANS + 2) * CHUNK + i] = view[2] * d_x + view[5] * d_y + view[8] * d_z

        abs_u, abs_v = planes[(GIVEN + 7) * CHUNK + i], planes[(GIVEN + 8) * CHUNK + i]
        planes[SHIFT * CHUNK + i] = _HALF * longer * math.sqrt(abs_u * abs_u + abs_v * abs_v)
        half = _HALF * (var_x - var_y)
        largest = _HALF * (var_x + var_y) + eps + math.sqrt(half * half + cov * cov)
        planes[EXTENT * CHUNK + i] = _F(3) * math.sqrt(largest) / longer
