"""Limits how often a training writes files."""

from __future__ import annotations

import math


class RateLimiter:
    """The pace of a repeated task: never within `least` seconds of the last time, at most `share` of the time, but at
    the latest after `most` seconds. Times are seconds of one clock."""

    def __init__(self, now: float, least: float, share: float = 1.0, most: float = math.inf) -> None:
        self._least, self._share, self._most = least, share, most
        self._last, self._pause = now, min(least, most)

    def is_due(self, now: float) -> bool:
        """Whether the task is due at the time `now`, seconds."""
        return now - self._last >= self._pause

    def record_run(self, began: float, ended: float) -> None:
        """Records that the task ran from `began` to `ended`, seconds."""
        self._last = ended
        self._pause = min(self._most, max(self._least, (ended - began) / self._share))
