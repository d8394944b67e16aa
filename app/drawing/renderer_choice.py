"""Chooses the renderer of a submap: the one that was faster when both were timed on it. Does not use Qt."""

from __future__ import annotations

CPU, OPENGL = "CPU", "OpenGL"
AUTOMATIC = "automatic"
PREFERENCES = (AUTOMATIC, CPU, OPENGL)
"""The choices of the user."""
ROUNDS = 3


class Choice:
    """Stores the render times of both renderers per submap, and chooses the faster one."""

    def __init__(self) -> None:
        self._times: dict[int, dict[str, list[float]]] = {}
        self._latest = CPU

    def to_time(self, submap: int) -> str | None:
        """The renderer to time next on this submap, alternating. None if both were timed ROUNDS times."""
        times = self._times.get(submap, {})
        counts = [(len(times.get(name, ())), name) for name in (OPENGL, CPU)]
        count, name = min(counts, key=lambda pair: pair[0])
        return name if count < ROUNDS else None

    def add(self, submap: int, renderer: str, milliseconds: float) -> bool:
        """Records a render time. Returns whether it was the last missing one, so that `faster` is now decided."""
        self._times.setdefault(submap, {}).setdefault(renderer, []).append(milliseconds)
        if self.to_time(submap) is not None:
            return False
        best = self.best(submap)
        self._latest = OPENGL if best[OPENGL] < best[CPU] else CPU
        return True

    def best(self, submap: int) -> dict[str, float]:
        """The shortest time of each renderer in milliseconds. The first frame is slower because it fills caches."""
        return {name: min(times) for name, times in self._times.get(submap, {}).items()}

    def faster(self, submap: int) -> str:
        """The faster renderer on this submap. Until both were timed: the result of the last timed submap, else CPU."""
        if self.to_time(submap) is not None:
            return self._latest
        best = self.best(submap)
        return OPENGL if best[OPENGL] < best[CPU] else CPU
