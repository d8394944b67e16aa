"""Which of the two renderers draws a submap: whichever was faster when both were timed on it. Knows no Qt."""

from __future__ import annotations

CPU, OPENGL = "CPU", "OpenGL"
AUTOMATIC = "automatic"
PREFERENCES = (AUTOMATIC, CPU, OPENGL)
"""What a user may ask for."""
ROUNDS = 3


class Choice:
    """Milliseconds of both renderers, by submap."""

    def __init__(self) -> None:
        self._times: dict[int, dict[str, list[float]]] = {}
        self._latest = CPU

    def to_time(self, submap: int) -> str | None:
        """Which renderer to time next on this submap, in turns; None when both were timed often enough."""
        times = self._times.get(submap, {})
        counts = [(len(times.get(name, ())), name) for name in (OPENGL, CPU)]
        count, name = min(counts, key=lambda pair: pair[0])
        return name if count < ROUNDS else None

    def add(self, submap: int, renderer: str, milliseconds: float) -> bool:
        """Whether this was the last that was missing, so that `faster` is decided now."""
        self._times.setdefault(submap, {}).setdefault(renderer, []).append(milliseconds)
        if self.to_time(submap) is not None:
            return False
        best = self.best(submap)
        self._latest = OPENGL if best[OPENGL] < best[CPU] else CPU
        return True

    def best(self, submap: int) -> dict[str, float]:
        """The least milliseconds of each: the first frame of a renderer pays for what later ones have."""
        return {name: min(times) for name, times in self._times.get(submap, {}).items()}

    def faster(self, submap: int) -> str:
        """The one that won on this submap; before that, the one that won on another; at first the CPU."""
        if self.to_time(submap) is not None:
            return self._latest
        best = self.best(submap)
        return OPENGL if best[OPENGL] < best[CPU] else CPU
