"""Powers and logarithms to the base 2 that LLVM vectorizes; all kernels use them instead of the library's scalar
exp."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from nvsim.kernels import njit

_F = np.float32
LOG2E = _F(1.4426950408889634)
LN2 = _F(0.6931471805599453)
FLAGS = {"contract", "reassoc", "arcp", "nsz"}
"""Optimizations for arithmetic on arbitrary values. They do not assume finite values, so a comparison with NaN fails as
written."""


# numba calls the intrinsics during compilation, with compiler and llvmlite objects that have no public types: hence
# Any. The returned signature has the argument types and the result type.
@intrinsic
def _float_of_bits(typing_context: Any, bits: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.FloatType())

    return types.float32(types.int32), build


@intrinsic
def _bits_of_float(typing_context: Any, value: Any) -> Any:
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(32))

    return types.uint32(types.float32), build


@njit(forceinline=True)
def depth_key(
    depth: np.float32,  # meters, above zero
) -> np.uint32:
    """The bits of a positive float as an unsigned integer, which keeps the order of the floats."""
    return _bits_of_float(depth)  # type: ignore[call-arg]


@njit(forceinline=True, fastmath=True, error_model="numpy")
def _scale_by_power(whole: np.int32, f: np.float32) -> np.float32:
    # The exponent bits hold `whole`; the rest is the degree 5 minimax polynomial of 2^f over [-0.5, 0.5].
    p = _F(1.32764719e-3)
    p = p * f + _F(9.67554121e-3)
    p = p * f + _F(5.55071332e-2)
    p = p * f + _F(2.40221204e-1)
    p = p * f + _F(6.93146978e-1)
    p = p * f + _F(1.00000007)
    exponent = (whole + np.int32(127)) << np.int32(23)
    return _float_of_bits(exponent) * p  # type: ignore[call-arg]


@njit(forceinline=True, fastmath=True, error_model="numpy")
def exp2(t: np.float32) -> np.float32:
    """2^t in single precision for |t| < 126, relative error below 3e-7."""
    whole = np.int32(t + math.copysign(_F(0.5), t))
    return _scale_by_power(whole, t - _F(whole))


@njit(forceinline=True, fastmath=True, error_model="numpy")
def exp2_below(t: np.float32) -> np.float32:
    """2^t for -126 < t < 0.5, without the sign test."""
    whole = np.int32(t - _F(0.5))
    return _scale_by_power(whole, t - _F(whole))


@njit(forceinline=True, fastmath=True, error_model="numpy")
def log2(x: np.float32) -> np.float32:
    """Logarithm to the base 2 of a normal positive number, absolute error below 4e-7 plus one rounding.

    x = m 2^e with m in [sqrt(1/2), sqrt(2)); then log m = 2 artanh((m - 1) / (m + 1)). This odd series converges fast,
    because the argument is at most 0.172.
    """
    bits = np.int32(_bits_of_float(x))  # type: ignore[call-arg]
    whole = (bits - np.int32(0x3F3504F3)) >> np.int32(23)
    m = _float_of_bits(bits - (whole << np.int32(23)))
    s = (m - _F(1)) / (m + _F(1))
    q = s * s
    series = ((_F(0.41219858) * q + _F(0.57707802)) * q + _F(0.96179669)) * q + _F(2.88539008)
    return _F(whole) + s * series
