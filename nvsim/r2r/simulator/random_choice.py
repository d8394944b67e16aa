"""The random numbers of Matterport3DSimulator, `minstd_rand0` with the distributions of the GNU library.

A seed therefore gives the episodes that it gives there.

Source: C++11 [rand.predef]; `uniform_int_distribution` and `generate_canonical` of libstdc++.
"""

from __future__ import annotations

_MODULUS = (1 << 31) - 1
_RANGE = _MODULUS - 2  # largest minus smallest number


class Minstd:
    """A generator of integers from 1 to 2**31 - 2."""

    def __init__(self, seed: int = 1) -> None:
        self._state = seed % (1 << 64) % _MODULUS or 1

    def _next(self) -> int:
        self._state = self._state * 16807 % _MODULUS
        return self._state - 1

    def below(self, count: int) -> int:
        """Returns a random integer from 0 to `count` - 1."""
        scale = _RANGE // count
        while True:
            drawn = self._next()
            if drawn < count * scale:
                return drawn // scale

    def real(self) -> float:
        """Returns a random number in [0, 1), made from two draws."""
        low, high = self._next(), self._next()
        size = float(_RANGE + 1)
        return (low + high * size) / (size * size)
