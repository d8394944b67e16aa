"""Measures the time of the parts of a step."""

from __future__ import annotations

import time


class Stopwatch:
    """Milliseconds between laps."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Records the time since the last lap under `name`."""
        now = time.perf_counter()
        self.laps[name] = 1e3 * (now - self._last)
        self._last = now
