"""What a simulator's time went into, in the words of Matterport3DSimulator."""

from __future__ import annotations

import time


class Timers:
    """Seconds of each part; a call is timed by being inside it. Of one simulator, whose calls take turns."""

    def __init__(self) -> None:
        self.preloading, self.frames = 0.0, 0
        self.reset()

    def reset(self) -> None:
        """Begins again; frames and preloading go on, as they do in the original."""
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
