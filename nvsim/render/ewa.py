"""The local affine projection of one Gaussian (Zwicker et al. 2001), in scalars. It is compiled into the forward and
the backward kernels."""

from __future__ import annotations

import numpy as np

from nvsim.kernels import njit
from nvsim.render.arithmetic import FLAGS
from nvsim.render.kernel_types import Float32, Matrix3, Vector3
from nvsim.splats import harmonics

_F = np.float32
_ONE, _TWO = _F(1), _F(2)

sh_terms = njit(forceinline=True, fastmath=FLAGS, error_model="numpy")(harmonics.terms)


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def rotation(w: np.float32, x: np.float32, y: np.float32, z: np.float32) -> Matrix3:
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
def to_camera(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    x: np.float32,  # world, as y and z
    y: np.float32,
    z: np.float32,
) -> Vector3:
    """Rotates a direction from the world to the axes of the camera; `view` is (33,)."""
    return (
        view[0] * x + view[1] * y + view[2] * z,
        view[3] * x + view[4] * y + view[5] * z,
        view[6] * x + view[7] * y + view[8] * z,
    )


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def jacobian(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    x: np.float32,  # meters, the camera's frame, as y and z
    y: np.float32,
    z: np.float32,
) -> tuple[np.float32, np.float32, np.float32, np.float32]:
    """Derivatives of the pixel by the camera-frame point: du/dx, du/dz, dv/dy, dv/dz. `view` is (33,)."""
    iz = _ONE / z
    slope_x = min(max(x * iz, view[18]), view[19])
    slope_y = min(max(y * iz, view[20]), view[21])
    return view[12] * iz, -view[12] * slope_x * iz, view[13] * iz, -view[13] * slope_y * iz


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def axes_in_camera(
    view: Float32,  # (33,) the camera, see `kernel_types.pack`
    r: Matrix3,  # from the Gaussian's axes to the world
    s0: np.float32,  # standard deviations in meters, as s1 and s2
    s1: np.float32,
    s2: np.float32,
) -> tuple[Vector3, Vector3, Vector3]:
    """The three semi-axes (columns of W R S) in the camera frame, by columns. `view` is (33,)."""
    a = to_camera(view, r[0] * s0, r[3] * s0, r[6] * s0)
    b = to_camera(view, r[1] * s1, r[4] * s1, r[7] * s1)
    c = to_camera(view, r[2] * s2, r[5] * s2, r[8] * s2)
    return a, b, c


@njit(forceinline=True, fastmath=FLAGS, error_model="numpy")
def determinant(p: Vector3, s: Vector3) -> np.float32:
    """det(M M^T) of the 2x3 matrix with rows p and s, as the squared length of p x s (Cauchy-Binet). This avoids the
    cancellation of A C - B^2 for thin Gaussians in single precision."""
    m0 = p[1] * s[2] - p[2] * s[1]
    m1 = p[2] * s[0] - p[0] * s[2]
    m2 = p[0] * s[1] - p[1] * s[0]
    return m0 * m0 + m1 * m1 + m2 * m2
