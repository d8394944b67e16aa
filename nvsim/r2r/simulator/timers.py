"""Measures the time of a simulator's parts and reports it in the format of Matterport3DSimulator."""

from __future__ import annotations

import time


class Timers:
    """Seconds of each part of one simulator. A call is timed by using this object as a context manager."""

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
