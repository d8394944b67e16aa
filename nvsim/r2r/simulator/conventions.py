"""What programs notice of Matterport3DSimulator beside its states: exceptions, arguments, random numbers, and timing.

The errors have the exception types that Matterport3DSimulator raises in these cases. They are also InputErrors, so that
the command line prints only their sentence. The random numbers are `minstd_rand0` with the distributions of the GNU
library, so that a seed gives the episodes that it gives there. Source: C++11 [rand.predef]; `uniform_int_distribution`
and `generate_canonical` of libstdc++.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from nvsim.errors import InputError

_MODULUS = (1 << 31) - 1
_RANGE = _MODULUS - 2  # largest minus smallest number


class UnknownScan(InputError, IndexError):
    """The scan id is not in scans.txt. Matterport3DSimulator raises `IndexError` (`map::at`)."""


class BatchMismatch(InputError, IndexError):
    """A list is shorter than the batch. Matterport3DSimulator raises `IndexError`."""


class InvalidValue(InputError, ValueError):
    """A viewpoint, an action, a graph file or an image is invalid. Matterport3DSimulator raises `ValueError`."""


class NotStarted(InputError, RuntimeError):
    """An action was called before an episode began. Matterport3DSimulator raises `RuntimeError`."""


class WrongType(InputError, TypeError):
    """Scalars were given where lists are needed, or the reverse. Matterport3DSimulator raises `TypeError`."""


def checked_names(given: str | Sequence[str], size: int, what: str) -> list[str]:
    """Returns the first `size` names; further values of a list are ignored, as in Matterport3DSimulator.

    Raises WrongType, BatchMismatch.
    """
    values = [given] if isinstance(given, str) else list(_list(given, what))
    for value in values:
        if not isinstance(value, str):
            raise WrongType(f"{what} contains {value!r}, which is not a string; give a list of ids.")
    _long_enough(len(values), size, what)
    return values[:size]


def checked_numbers(given: float | Sequence[float], size: int, what: str) -> list[float]:
    """Returns the first `size` numbers. Raises WrongType, BatchMismatch, and InvalidValue if one is not finite."""
    values = [float(value) for value in _first_values(given, size, what, float, "fiub")]
    if not math.isfinite(sum(values)):  # a value is not finite, or the sum overflows
        raise InvalidValue(f"{what} is {given!r}; give finite radians.")
    return values


def checked_counts(given: int | Sequence[int], size: int, what: str) -> list[int]:
    """Returns the first `size` integers, 0 or more. Raises WrongType, BatchMismatch."""
    values = _first_values(given, size, what, int, "iub")
    if min(values) < 0:
        raise WrongType(f"{what} is {given!r}; give whole numbers from 0.")
    return [int(value) for value in values]


def _first_values(given: Any, size: int, what: str, kind: type, kinds: str) -> list[Any]:
    """Returns the first `size` values, which numpy converts unless all are of one `kind`."""
    values = given if type(given) is list else [given]
    if set(map(type, values)) != {kind}:
        try:
            array = np.array(given, ndmin=1)
        except ValueError:  # lists of different lengths
            array = np.empty((0, 0))
        if array.ndim != 1 or (array.dtype.kind not in kinds and array.size):
            raise WrongType(f"{what} is {given!r}; give one number for each environment.")
        values = array.tolist()
    _long_enough(len(values), size, what)
    return values[:size]


def _list(given: Any, what: str) -> Any:
    if not hasattr(given, "__iter__"):
        raise WrongType(f"{what} is {given!r}; give one value for each environment.")
    return given


def _long_enough(length: int, size: int, what: str) -> None:
    if length < size:
        raise BatchMismatch(f"{what} has {length} values, but the batch has {size} environments; give one for each.")


class Minstd:
    """A generator of integers from 1 to 2**31 - 2."""

    def __init__(self, seed: int = 1) -> None:
        self._state = seed % (1 << 64) % _MODULUS or 1

    def _next(self) -> int:
        self._state = self._state * 16807 % _MODULUS
        return self._state - 1

    def random_below(self, count: int) -> int:
        """Returns a random integer from 0 to `count` - 1."""
        scale = _RANGE // count
        while True:
            drawn = self._next()
            if drawn < count * scale:
                return drawn // scale

    def random_float(self) -> float:
        """Returns a random number in [0, 1), made from two draws."""
        low, high = self._next(), self._next()
        size = float(_RANGE + 1)
        return (low + high * size) / (size * size)


class Timers:
    """Seconds of each part of one simulator, as text in the format of Matterport3DSimulator. A call is timed by using
    this object as a context manager."""

    def __init__(self) -> None:
        self.preloading, self.frames = 0.0, 0
        self.reset()

    def reset(self) -> None:
        """Resets the times. Frames and preloading are not reset, as in Matterport3DSimulator."""
        self.rendering = self.processing = 0.0
        self._begin: float | None = None

    def __enter__(self) -> None:
        self._entered = time.perf_counter()
        if self._begin is None:
            self._begin = self._entered

    def __exit__(self, *_: object) -> None:
        self.processing += time.perf_counter() - self._entered

    def add(self, begin: float) -> None:
        """Adds a call that began at `begin`, seconds of `time.perf_counter`, and ends now."""
        if self._begin is None:
            self._begin = begin
        self.processing += time.perf_counter() - begin

    def __str__(self) -> str:
        wall = 0.0 if self._begin is None else time.perf_counter() - self._begin
        each = [self.frames / s if s else 0.0 for s in (wall, self.processing)]
        return (
            f"Preloading images: {self.preloading / 60:g} minutes\n"
            f"Rendered {self.frames} frames\n"
            f"Wall time: {1e3 * wall:g} ms, ({each[0]:g} fps)\n"
            f"Process time: {1e3 * self.processing:g} ms, ({each[1]:g} fps)\n"
            f"\tRendering: {1e3 * self.rendering:g} ms\n"
        )
