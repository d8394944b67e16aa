"""The scene model: all submap models of a building, of which few need to be in memory at once."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.splats.files import load_model
from nvsim.splats.types import SubmapModel
from nvsim.submaps.types import Submap, nearest_submap

GIBIBYTE = 1 << 30


class SceneModel:
    """Answers which submap model draws a view from a position. Models are loaded when first asked for, and the least
    recently used are let go when together they exceed the budget; the one asked for always stays. Thread-safe.

    submaps         all of them, whether trained or not
    folders         where the model of each is, None for one that is not trained
    memory_budget   bytes of arrays

    Raises ValueError when the lists do not match or no submap has a model.
    """

    def __init__(
        self, submaps: Sequence[Submap], folders: Sequence[Path | None], memory_budget: int = 2 * GIBIBYTE
    ) -> None:
        if len(submaps) != len(folders):
            raise ValueError(f"{len(submaps)} submaps but {len(folders)} folders")
        self._folders = {s.index: f for s, f in zip(submaps, folders) if f is not None}
        self._submaps = [s for s in submaps if s.index in self._folders]
        if not self._submaps:
            raise ValueError("a scene model needs at least one trained submap")
        self._budget = memory_budget
        self._lock = threading.Lock()
        self._loaded: OrderedDict[int, SubmapModel] = OrderedDict()

    @property
    def indices(self) -> tuple[int, ...]:
        """Indices of the submaps that have a model."""
        return tuple(s.index for s in self._submaps)

    @property
    def loaded(self) -> tuple[int, ...]:
        """Indices of the models in memory, least recently used first."""
        with self._lock:
            return tuple(self._loaded)

    def nearest(self, position: NDArray[np.floating]) -> int:
        """Index of the submap, among those with a model, with the core camera nearest to `position` (3,)."""
        return nearest_submap(self._submaps, position)

    def model_at(self, position: NDArray[np.floating]) -> tuple[int, SubmapModel]:
        """Index and model of `nearest`. Raises InputError when its files cannot be read."""
        index = self.nearest(position)
        return index, self.model(index)

    def model(self, index: int) -> SubmapModel:
        """The model of a submap. Raises KeyError when it has none, InputError when its files cannot be read."""
        with self._lock:
            found = self._loaded.get(index)
            if found is None:
                found = self._loaded[index] = load_model(self._folders[index])
            self._loaded.move_to_end(index)
            while len(self._loaded) > 1 and sum(map(memory_of, self._loaded.values())) > self._budget:
                self._loaded.popitem(last=False)
            return found


def memory_of(model: SubmapModel) -> int:
    """Bytes of the model's arrays."""
    g = model.gaussians
    arrays = [g.means, g.log_scales, g.quats, g.opacity_logits, g.sh, model.floor.heights]
    if model.background is not None:
        arrays += list(model.background.weights.values())
    if model.texture is not None:
        arrays += list(model.texture.levels)
    return sum(a.nbytes for a in arrays)
