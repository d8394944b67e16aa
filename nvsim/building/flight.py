"""The straight flight of stairs between two storeys: its treads, and the height of a point on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nvsim.building.plan import HEIGHT, SLAB, Rect

GOING = 0.28  # meters from riser to riser
RISERS = 18  # of 0.167 m each, between floors that are 3 m apart
LENGTH = (RISERS - 1) * GOING  # meters from the first riser to the last, which ends on the upper floor


@dataclass(frozen=True)
class Flight:
    """foot, head  (x, y) meters of the middle of the first and of the last riser, on a line along x or y
    width       meters between the walls
    """

    foot: tuple[float, float]
    head: tuple[float, float]
    width: float

    @property
    def climb(self) -> float:
        """Meters from the lower floor to the upper one."""
        return HEIGHT + SLAB

    @property
    def rise(self) -> float:
        """Height of one step, meters."""
        return self.climb / RISERS

    @property
    def rect(self) -> Rect:
        """The ground under the treads, which is also the opening in the floor above, meters."""
        return self._between(0, RISERS - 1)

    def treads(self) -> list[tuple[Rect, float]]:
        """The ground of each tread and its height above the lower floor, meters, from the lowest tread on."""
        return [(self._between(i, i + 1), (i + 1) * self.rise) for i in range(RISERS - 1)]

    @property
    def direction(self) -> NDArray[np.float64]:
        """(2,) the unit vector from foot to head."""
        ahead = np.array(self.head) - np.array(self.foot)
        return np.asarray(ahead / np.linalg.norm(ahead))

    def along(self, xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """(...) distances of places (..., 2) from the first riser toward the last one, meters."""
        return np.asarray((np.asarray(xy, np.float64) - self.foot) @ self.direction)

    def height_at(self, xy: NDArray[np.floating]) -> NDArray[np.float64]:
        """(...) meters above the lower floor at places (..., 2) on the stairs or near their ends. This is the line
        through the middles of the treads, from half a tread before the first riser to half a tread behind the last. The
        surface of a tread is within half a rise of it."""
        return np.asarray(np.clip(self.rise * (self.along(xy) / GOING + 0.5), 0.0, self.climb))

    def mapped(self, point: Callable[[float, float], tuple[float, float]]) -> Flight:
        """The mirror image or quarter turn by `point`."""
        return replace(self, foot=point(*self.foot), head=point(*self.head))

    def _between(self, first: int, last: int) -> Rect:
        """The ground between two risers, rounded to a micrometer, so that neighbors have exactly equal edges."""
        (x0, y0), (x1, y1) = self._at(first), self._at(last)
        low, high = (min(x0, x1), min(y0, y1)), (max(x0, x1), max(y0, y1))
        sides = (0.0, self.width / 2) if abs(x1 - x0) > abs(y1 - y0) else (self.width / 2, 0.0)
        edges = low[0] - sides[0], low[1] - sides[1], high[0] + sides[0], high[1] + sides[1]
        return Rect(*(round(e, 6) for e in edges))

    def _at(self, riser: int) -> tuple[float, float]:
        share = riser / (RISERS - 1)
        (x0, y0), (x1, y1) = self.foot, self.head
        return x0 + share * (x1 - x0), y0 + share * (y1 - y0)
