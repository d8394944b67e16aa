"""Checks the arguments of a call, one value for each environment of the batch: scalars for a batch of one, or lists."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.r2r.simulator.errors import BatchMismatch, InvalidValue, WrongType


def names(given: str | Sequence[str], size: int, what: str) -> list[str]:
    """Returns the first `size` names; further values of a list are ignored, as in Matterport3DSimulator.

    Raises WrongType, BatchMismatch.
    """
    values = [given] if isinstance(given, str) else list(_list(given, what))
    for value in values:
        if not isinstance(value, str):
            raise WrongType(f"{what} contains {value!r}, which is not a string; give a list of ids.")
    _long_enough(len(values), size, what)
    return values[:size]


def numbers(given: float | Sequence[float], size: int, what: str) -> NDArray[np.float64]:
    """Returns a copy of the numbers (size,). Raises WrongType, BatchMismatch, and InvalidValue if one is not finite."""
    values = _array(given, size, what, "fiub").astype(np.float64)
    if not math.isfinite(values.sum()):  # a value is not finite, or the sum overflows
        raise InvalidValue(f"{what} is {given!r}; give finite radians.")
    return values


def counts(given: int | Sequence[int], size: int, what: str) -> NDArray[np.int64]:
    """Returns integers (size,), 0 or more. Raises WrongType, BatchMismatch."""
    values = _array(given, size, what, "iub")
    if values.min() < 0:
        raise WrongType(f"{what} is {given!r}; give whole numbers from 0.")
    return values.astype(np.int64)


def _array(given: Any, size: int, what: str, kinds: str) -> NDArray[Any]:
    try:
        values = np.array(given, ndmin=1)
    except ValueError:  # lists of different lengths
        values = np.empty((0, 0))
    if values.ndim != 1 or (values.dtype.kind not in kinds and values.size):
        raise WrongType(f"{what} is {given!r}; give one number for each environment.")
    _long_enough(len(values), size, what)
    return values[:size]


def _list(given: Any, what: str) -> Any:
    if not hasattr(given, "__iter__"):
        raise WrongType(f"{what} is {given!r}; give one value for each environment.")
    return given


def _long_enough(length: int, size: int, what: str) -> None:
    if length < size:
        raise BatchMismatch(f"{what} has {length} values, but the batch has {size} environments; give one for each.")
