"""Chooses how a submap is rendered: by the renderer that was faster on it, and with how many Gaussians. Does not use
Qt."""

from __future__ import annotations

import weakref
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.splats.types import Gaussians, SubmapModel

CPU, OPENGL = "CPU", "OpenGL"
AUTOMATIC = "automatic"
PREFERENCES = (AUTOMATIC, CPU, OPENGL)
"""The choices of the user."""
ROUNDS = 3


class RendererChoice:
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


def largest_gaussians(gaussians: Gaussians, count: int) -> NDArray[np.int64]:
    """(M,) rows of the `count` Gaussians that cover the largest area, in ascending order; all rows if there are fewer.
    The covered area is the product of the two largest extents and the opacity."""
    if len(gaussians) <= count:
        return np.arange(len(gaussians))
    two_largest = np.sort(gaussians.log_scales, axis=1)[:, 1:].sum(axis=1)
    cover = two_largest - np.log1p(np.exp(-gaussians.opacity_logits))
    return np.sort(np.argpartition(-cover, count)[:count])


@dataclass
class _ThinnedModel:
    of: weakref.ref[SubmapModel]
    count: int
    model: SubmapModel


class SplatBudget:
    """Limits the number of Gaussians of a model. Caches the last result, which a moving camera needs repeatedly."""

    def __init__(self) -> None:
        self._last: _ThinnedModel | None = None

    def limit_model(self, model: SubmapModel, count: int) -> SubmapModel:
        """`model` with at most `count` Gaussians; 0 means all."""
        if count <= 0 or len(model.gaussians) <= count:
            return model
        last = self._last
        if last is None or last.of() is not model or last.count != count:
            rows = largest_gaussians(model.gaussians, count)
            last = self._last = _ThinnedModel(weakref.ref(model), count, model.selected(rows))
        return last.model
