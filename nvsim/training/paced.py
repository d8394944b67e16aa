"""How often a training stops to write something down."""

from __future__ import annotations

import math


class Paced:
    """Something done now and then: not within `least` seconds of the last time, at most `share` of the time, and after
    `most` seconds whatever it takes. Times are those of one clock, seconds."""

    def __init__(self, now: float, least: float, share: float = 1.0, most: float = math.inf) -> None:
        self._least, self._share, self._most = least, share, most
        self._last, self._pause = now, min(least, most)

    def is_due(self, now: float) -> bool:
        return now - self._last >= self._pause

    def done(self, began: float, ended: float) -> None:
        """It was done from one time to another."""
        self._last = ended
        self._pause = min(self._most, max(self._least, (ended - began) / self._share))
