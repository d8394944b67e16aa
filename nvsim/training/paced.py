"""The pace at which a training writes things down."""

from __future__ import annotations

import math


class Paced:
    """The pace of a work that is repeated: not within `least` seconds of the last time, at most `share` of the time,
    and after `most` seconds at the latest. Times are those of one clock, seconds."""

    def __init__(self, now: float, least: float, share: float = 1.0, most: float = math.inf) -> None:
        self._least, self._share, self._most = least, share, most
        self._last, self._pause = now, min(least, most)

    def is_due(self, now: float) -> bool:
        return now - self._last >= self._pause

    def done(self, began: float, ended: float) -> None:
        """It was done from one time to another."""
        self._last = ended
        self._pause = min(self._most, max(self._least, (ended - began) / self._share))
