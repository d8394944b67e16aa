"""The real spherical harmonics of 3D Gaussian splatting, degrees 0 to 4, in the order and with the signs of its files
(Kerbl et al. 2023; degree l starts at index l^2, odd m negative: Y1 = -y, z, -x)."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

# Single-precision constants: kernels compile the same functions, and a double would convert all values to double.
_F = np.float32
_0 = _F(0.28209479177387814)
_1 = _F(0.4886025119029199)
_2A, _2B, _2C = _F(1.0925484305920792), _F(0.31539156525252005), _F(0.5462742152960396)
_3A, _3B, _3C, _3D, _3E = (
    _F(0.5900435899266435),
    _F(2.890611442640554),
    _F(0.4570457994644658),
    _F(0.3731763325901154),
    _F(1.445305721320277),
)
_4A, _4B, _4C, _4D, _4E, _4F, _4G = (
    _F(2.5033429417967046),
    _F(1.7701307697799304),
    _F(0.9461746957575601),
    _F(0.6690465435572892),
    _F(0.10578554691520431),
    _F(0.47308734787878004),
    _F(0.6258357354491761),
)
_ONE, _TWO, _THREE, _FOUR, _SEVEN, _THIRTY, _THIRTY_FIVE = _F(1), _F(2), _F(3), _F(4), _F(7), _F(30), _F(35)

DC = float(_0)
"""The constant function: color = 0.5 + DC * coefficient 0."""

Value = TypeVar("Value", np.float32, NDArray[np.float32], NDArray[np.float64])
"""A number in a kernel, or an array of any shape."""


def terms(x: Value, y: Value, z: Value) -> tuple[Value, ...]:
    """The 25 functions at a unit direction x, y, z. Works on numbers and on arrays of one shape, so kernels can compile
    it."""
    xx, yy, zz = x * x, y * y, z * z
    xy, yz, xz = x * y, y * z, x * z
    return (
        _0 + _F(0) * x,
        -_1 * y,
        _1 * z,
        -_1 * x,
        _2A * xy,
        -_2A * yz,
        _2B * (_TWO * zz - xx - yy),
        -_2A * xz,
        _2C * (xx - yy),
        -_3A * y * (_THREE * xx - yy),
        _3B * xy * z,
        -_3C * y * (_FOUR * zz - xx - yy),
        _3D * z * (_TWO * zz - _THREE * xx - _THREE * yy),
        -_3C * x * (_FOUR * zz - xx - yy),
        _3E * z * (xx - yy),
        -_3A * x * (xx - _THREE * yy),
        _4A * xy * (xx - yy),
        -_4B * yz * (_THREE * xx - yy),
        _4C * xy * (_SEVEN * zz - _ONE),
        -_4D * yz * (_SEVEN * zz - _THREE),
        _4E * (zz * (_THIRTY_FIVE * zz - _THIRTY) + _THREE),
        -_4D * xz * (_SEVEN * zz - _THREE),
        _4F * (xx - yy) * (_SEVEN * zz - _ONE),
        -_4B * xz * (xx - _THREE * yy),
        _4G * (xx * (xx - _THREE * yy) - yy * (_THREE * xx - yy)),
    )


def basis_gradients(x: Value, y: Value, z: Value) -> tuple[tuple[Value, Value, Value], ...]:
    """The gradients of the first 16 functions, with x, y, z treated as independent variables. Only the component
    perpendicular to the direction is meaningful. x, y, z are numbers, or arrays of one shape."""
    xx, yy, zz = x * x, y * y, z * z
    xy, yz, xz = x * y, y * z, x * z
    o = _F(0) * x
    six, eight = _F(6), _F(8)
    return (
        (o, o, o),
        (o, o - _1, o),
        (o, o, o + _1),
        (o - _1, o, o),
        (_2A * y, _2A * x, o),
        (o, -_2A * z, -_2A * y),
        (-_TWO * _2B * x, -_TWO * _2B * y, _FOUR * _2B * z),
        (-_2A * z, o, -_2A * x),
        (_TWO * _2C * x, -_TWO * _2C * y, o),
        (-six * _3A * xy, -_THREE * _3A * (xx - yy), o),
        (_3B * yz, _3B * xz, _3B * xy),
        (_TWO * _3C * xy, -_3C * (_FOUR * zz - xx - _THREE * yy), -eight * _3C * yz),
        (-six * _3D * xz, -six * _3D * yz, _THREE * _3D * (_TWO * zz - xx - yy)),
        (-_3C * (_FOUR * zz - _THREE * xx - yy), _TWO * _3C * xy, -eight * _3C * xz),
        (_TWO * _3E * xz, -_TWO * _3E * yz, _3E * (xx - yy)),
        (-_THREE * _3A * (xx - yy), six * _3A * xy, o),
    )


def basis(directions: NDArray[np.floating], degree: int) -> NDArray[np.float32]:
    """(..., (degree + 1)^2) float32 values at unit `directions` (..., 3), degree 0 to 4."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float32), -1, 0)
    return np.stack(terms(x, y, z)[: (degree + 1) ** 2], axis=-1).astype(np.float32)
