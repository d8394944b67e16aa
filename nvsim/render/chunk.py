"""Splats of a chunk of Gaussians, several at a time in a vector: equations 3 to 5 of Kerbl et al. 2023 over planes.

A plane has one value of every Gaussian of the chunk. Input: x, y, z in the camera's frame, whether near; log scales
(3), quaternion (4), opacity logit. Output, from 12 on: u, v, conic (3), log opacity, opacity, half width and height,
depth, normal (3), whether drawn; from BASIS on, the harmonics of the direction. All planes are in one buffer at
constant distances, so that LLVM knows that they do not overlap.
"""

from __future__ import annotations

import math

import numpy as np

from nvsim.kernels import njit
from nvsim.render.arithmetic import FLAGS, LN2, LOG2E, exp2, log2
from nvsim.render.ewa import axes_in_camera, determinant, jacobian, rotation, sh_terms, to_camera
from nvsim.render.kernel_types import LOG_CUT, Float32

CHUNK = 64
"""Number of Gaussians that are processed together, so that their planes stay in the nearest cache. The loops always
cover all of them, because LLVM rounds values after the last whole vector differently."""
PLANES, BASIS = 42, 26
_F = np.float32
_ONE, _TWO, _HALF = _F(1), _F(2), _F(0.5)


# No "nnan" among the flags: comparisons must fail for a Gaussian that is not finite, so that it is skipped.
@njit(fastmath=FLAGS, error_model="numpy")
def splats_of(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    planes: Float32,  # (PLANES * CHUNK or more,) see the module; those from 12 on are written
) -> None:
    """Computes the splats of a chunk, in a plain loop without branches that LLVM vectorizes."""
    eps = view[25]
    for i in range(CHUNK):
        x, y, z = planes[i], planes[CHUNK + i], planes[2 * CHUNK + i]
        s0 = exp2(min(max(LOG2E * planes[4 * CHUNK + i], _F(-30)), _F(30)))
        s1 = exp2(min(max(LOG2E * planes[5 * CHUNK + i], _F(-30)), _F(30)))
        s2 = exp2(min(max(LOG2E * planes[6 * CHUNK + i], _F(-30)), _F(30)))
        qw, qx, qy, qz = (
            planes[7 * CHUNK + i],
            planes[8 * CHUNK + i],
            planes[9 * CHUNK + i],
            planes[10 * CHUNK + i],
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
        sigmoid = _ONE / (_ONE + exp2(min(max(-LOG2E * planes[11 * CHUNK + i], _F(-60)), _F(60))))
        share = math.sqrt(thin / wide) if view[26] > _HALF else _ONE
        opacity = sigmoid * share
        iz = _ONE / z
        u, v = view[12] * x * iz + view[14] - _HALF, view[13] * y * iz + view[15] - _HALF
        log_opacity = log2(max(opacity, _F(1e-6)))
        reach = math.sqrt(max(_TWO * LN2 * (log_opacity - LOG_CUT), _F(0)))
        half_width, half_height = reach * math.sqrt(var_x + eps), reach * math.sqrt(var_y + eps)
        scale = -_HALF * LOG2E / wide
        planes[12 * CHUNK + i], planes[13 * CHUNK + i] = u, v
        planes[14 * CHUNK + i], planes[15 * CHUNK + i], planes[16 * CHUNK + i] = (
            scale * (var_y + eps),
            -_TWO * scale * cov,
            scale * (var_x + eps),
        )
        planes[17 * CHUNK + i], planes[18 * CHUNK + i] = log_opacity, opacity
        planes[19 * CHUNK + i], planes[20 * CHUNK + i], planes[21 * CHUNK + i] = half_width, half_height, z
        # The shortest axis, turned toward the camera.
        first = s0 <= s1 and s0 <= s2
        second = s1 <= s2
        nx = r[0] if first else (r[1] if second else r[2])
        ny = r[3] if first else (r[4] if second else r[5])
        nz = r[6] if first else (r[7] if second else r[8])
        cx, cy, cz = to_camera(view, nx, ny, nz)
        sign = -_ONE if cx * x + cy * y + cz * z > _F(0) else _ONE
        planes[22 * CHUNK + i], planes[23 * CHUNK + i], planes[24 * CHUNK + i] = sign * nx, sign * ny, sign * nz
        drawn = sigmoid * _F(255) > _ONE and opacity * _F(255) > _ONE and length > _F(1e-20) and wide < _F(1e18)
        across = u + half_width > view[29] and u - half_width < view[30]
        along = v + half_height > view[31] and v - half_height < view[32]
        planes[25 * CHUNK + i] = _ONE if (drawn and across and along) else _F(0)


@njit(fastmath=FLAGS, error_model="numpy")
def harmonics_of(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    planes: Float32,  # (PLANES * CHUNK or more,) reads the first three, writes the 16 from BASIS on
) -> None:
    """Computes the harmonics of the directions from the camera to the Gaussians of a chunk."""
    for i in range(CHUNK):
        x, y, z = planes[i], planes[CHUNK + i], planes[2 * CHUNK + i]
        inverse = _ONE / math.sqrt(x * x + y * y + z * z)
        dx = (view[0] * x + view[3] * y + view[6] * z) * inverse
        dy = (view[1] * x + view[4] * y + view[7] * z) * inverse
        dz = (view[2] * x + view[5] * y + view[8] * z) * inverse
        values: tuple[np.float32, ...] = sh_terms(dx, dy, dz)
        planes[(BASIS + 0) * CHUNK + i] = values[0]
        planes[(BASIS + 1) * CHUNK + i] = values[1]
        planes[(BASIS + 2) * CHUNK + i] = values[2]
        planes[(BASIS + 3) * CHUNK + i] = values[3]
        planes[(BASIS + 4) * CHUNK + i] = values[4]
        planes[(BASIS + 5) * CHUNK + i] = values[5]
        planes[(BASIS + 6) * CHUNK + i] = values[6]
        planes[(BASIS + 7) * CHUNK + i] = values[7]
        planes[(BASIS + 8) * CHUNK + i] = values[8]
        planes[(BASIS + 9) * CHUNK + i] = values[9]
        planes[(BASIS + 10) * CHUNK + i] = values[10]
        planes[(BASIS + 11) * CHUNK + i] = values[11]
        planes[(BASIS + 12) * CHUNK + i] = values[12]
        planes[(BASIS + 13) * CHUNK + i] = values[13]
        planes[(BASIS + 14) * CHUNK + i] = values[14]
        planes[(BASIS + 15) * CHUNK + i] = values[15]
