"""The positions that steps lead to, independent of the path: a position is a start and the number of steps in each
direction.

Adding steps one by one would give positions that differ in the last bit between paths, and evidence that is almost, but
not exactly, that of another build. Each position is shifted slightly from its lattice point, by an offset derived from
its counts, so that no two paths have exactly equal lengths.
"""

from __future__ import annotations

import hashlib
import math

import numpy as np
from numpy.typing import NDArray

from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS, ahead, headings

_AXES = DIRECTIONS // 2  # direction k + 4 is opposite to direction k


class Lattice:
    """Stores for the id of every viewpoint the start that it descends from and its counts of steps along four axes."""

    def __init__(self, config: MappingConfig) -> None:
        self._jitter = config.jitter
        self._steps = [ahead(h, config.tau_dist) for h in headings(config)[:_AXES]]
        self._at: dict[str, tuple[tuple[float, float], tuple[int, ...]]] = {}

    def begin(self, id: str, xy: tuple[float, float]) -> None:
        """Add a start at `xy`, from which steps descend."""
        self._at[id] = (xy, (0,) * _AXES)

    def take(self, id: str, origin: str, direction: int) -> None:
        """Record that the step from `origin` leads to the viewpoint `id`."""
        start, counts = self._at[origin]
        self._at[id] = (start, self._moved(counts, direction))

    def target(self, id: str, direction: int) -> tuple[float, float]:
        """Return world x, y in meters to which the step from `id` leads."""
        start, counts = self._at[id]
        moved = self._moved(counts, direction)
        offset = sum((n * step for n, step in zip(moved, self._steps, strict=True)), np.zeros(2))
        offset += self._beside(start, moved)
        return float(start[0] + offset[0]), float(start[1] + offset[1])

    def _beside(self, start: tuple[float, float], counts: tuple[int, ...]) -> NDArray[np.float64]:
        """(2,) meters, uniform in a disc of radius `jitter`; zero for the start itself."""
        if not self._jitter or not any(counts):
            return np.zeros(2)
        drawn = hashlib.blake2b(repr((round(start[0], 3), round(start[1], 3), counts)).encode(), digest_size=8).digest()
        square, turn = (int.from_bytes(part, "big") / 2**32 for part in (drawn[:4], drawn[4:]))
        return ahead(2 * math.pi * turn, self._jitter * math.sqrt(square))

    def _moved(self, counts: tuple[int, ...], direction: int) -> tuple[int, ...]:
        sign = 1 if direction < _AXES else -1
        return tuple(n + sign * (k == direction % _AXES) for k, n in enumerate(counts))
