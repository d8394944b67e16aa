"""The scene model: all submap models of a building. Only a few of them need to be in memory at once."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.splats.files import DESCRIPTION, load_model, memory_needed
from nvsim.splats.types import SubmapModel
from nvsim.submaps.split import Submap, storeys_of

T = TypeVar("T")
NEAR_BORDER = 3.0
"""Meters. If the second nearest submap is less than this farther away than the nearest, it is loaded ahead. The camera
is then at most half of this from the border between them."""


class SceneModel:
    """Selects the submap model for a camera position and loads models on demand. Before a model is loaded, the least
    recently used ones are unloaded until the new one fits the budget. A requested model is loaded even if it alone
    exceeds the budget. Thread-safe: loading one model does not block requests for another.

    submaps         all submaps, trained or not
    folders         folder of each submap's model, None if it is not trained
    memory_budget   bytes of arrays; None uses `default_budget`
    ahead           whether `model_at` loads the next submap in a background thread if the position is near its
                    border and it fits without unloading the model in use
    moved           returns the new folder of a submap's model when the known one vanished, because training ended or
                    the model was replaced
    colors          whether models keep their colors; if not, they are gray, without background, and need a fifth of the
                    memory

    Raises ValueError if the lists have different lengths or no submap has a model.
    """

    def __init__(
        self,
        submaps: Sequence[Submap],
        folders: Sequence[Path | None],
        memory_budget: int | None = None,
        ahead: bool = True,
        moved: Callable[[int], Path] | None = None,
        colors: bool = True,
    ) -> None:
        if len(submaps) != len(folders):
            raise ValueError(f"{len(submaps)} submaps but {len(folders)} folders")
        self._folders = {s.index: f for s, f in zip(submaps, folders) if f is not None}
        self._submaps = [s for s in submaps if s.index in self._folders]
        if not self._submaps:
            raise ValueError("a scene model needs at least one trained submap")
        self._budget = default_budget() if memory_budget is None else memory_budget
        self._ahead = ahead
        self._moved = moved
        self._colors = colors
        self._positions = np.concatenate([s.positions for s in self._submaps])
        self._firsts = np.cumsum([0, *(len(s.positions) for s in self._submaps[:-1])])
        self._frames = np.concatenate([s.core for s in self._submaps]).astype(np.int64)
        self._trained = [np.asarray(s.frames, np.int64) for s in self._submaps]
        self._tree: Any = None  # KD tree of the positions, built on first use
        self._measured = b"", np.zeros(0)  # last queried position and its distances
        self._asking = threading.Lock()  # held by the thread that loads a requested model
        self._changed = threading.Condition()  # guards all fields below
        self._loaded: OrderedDict[int, SubmapModel] = OrderedDict()
        self._loading: dict[int, int] = {}  # index -> bytes reserved for it
        self._needed: dict[int, int] = {}  # index -> bytes, of submaps that were considered for loading ahead
        self._hopeless: set[int] = set()  # models that could not be loaded ahead; a request for one reports the error

    @property
    def indices(self) -> tuple[int, ...]:
        """Indices of the submaps that have a model."""
        return tuple(s.index for s in self._submaps)

    @property
    def loaded(self) -> tuple[int, ...]:
        """Indices of the models in memory, least recently used first."""
        with self._changed:
            return tuple(self._loaded)

    @property
    def memory(self) -> int:
        """Bytes of the models in memory and of those that are being loaded."""
        with self._changed:
            return self._memory_in_use()

    def nearest(self, position: NDArray[np.floating]) -> int:
        """Index of the submap whose core camera is nearest to `position` (3,), meters, world, among those with a model
        (paper Algorithm 1, line 4)."""
        return self._submaps[int(np.argmin(self._distances(position)))].index

    def second(self, position: NDArray[np.floating]) -> int | None:
        """Index of a second submap that covers `position` (3,), meters, world; None if there is none. It was trained on
        the frame nearest to the position, and its core camera is the next nearest. Submaps on stairs are skipped,
        because their frames look along the stairs and hardly show the adjacent floors."""
        if len(self._submaps) == 1:
            return None
        frame = self._nearest_frames(np.asarray(position)[None])[0]
        for i in np.argsort(self._distances(position), kind="stable")[1:]:
            if frame in self._trained[i] and not self._on_stairs[i]:
                return self._submaps[i].index
        return None

    @cached_property
    def _on_stairs(self) -> list[bool]:
        """For each submap, whether most of its core climbs from one storey to another."""
        climbs = storeys_of(self._positions).part % 2 == 1
        return [bool(np.mean(part) > 0.5) for part in np.split(climbs, self._firsts[1:])]

    def trained_at(self, index: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) bool, whether a submap was trained on the frame nearest to each of `positions` (N, 3), meters, world."""
        return self._is_trained[index][self._nearest_frames(positions)]

    @cached_property
    def _is_trained(self) -> dict[int, NDArray[np.bool_]]:
        """For each submap, whether it was trained on each frame (frames,)."""
        count = 1 + max(int(frames.max()) for frames in (self._frames, *self._trained))
        found = {submap.index: np.zeros(count, bool) for submap in self._submaps}
        for submap, frames in zip(self._submaps, self._trained, strict=True):
            found[submap.index][frames] = True
        return found

    def _nearest_frames(self, positions: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N,) the frames nearest to `positions` (N, 3)."""
        if self._tree is None:
            from scipy.spatial import cKDTree

            self._tree = cKDTree(self._positions)
        return np.asarray(self._frames[self._tree.query(positions)[1]])

    def model_at(self, position: NDArray[np.floating]) -> tuple[int, SubmapModel]:
        """Index and model of the submap `nearest` to `position` (3,), meters, world. Raises InputError if its files
        cannot be read."""
        distances = self._distances(position)
        order = np.argsort(distances, kind="stable")[:2]
        index = self._submaps[int(order[0])].index
        model = self.model(index)
        if self._ahead and len(order) > 1 and distances[order[1]] - distances[order[0]] < NEAR_BORDER:
            self._load_ahead(self._submaps[int(order[1])].index)
        return index, model

    def model(self, index: int) -> SubmapModel:
        """The model of a submap. Raises KeyError if it has none, InputError if its files cannot be read."""
        if index not in self._folders:
            raise KeyError(index)
        with self._changed:
            found = self._find(index)
        if found is not None:
            return found
        with self._asking:
            needed = self._with_folder(index, memory_needed)
            with self._changed:
                found = self._find(index)  # another thread may have been faster
                if found is not None:
                    return found
                self._loading[index] = needed
                self._unload_least_used(keep=0)
                # A model that is being loaded ahead can be unloaded only after it is loaded.
                while self._memory_in_use() > self._budget and len(self._loading) > 1:
                    self._changed.wait()
                    self._unload_least_used(keep=0)
            model = None
            try:
                model = self._with_folder(index, self._load)
            finally:
                self._end(index, model)
            return model

    def _load(self, folder: Path) -> SubmapModel:
        model = load_model(folder)
        return model if self._colors else _gray(model)

    def _with_folder(self, index: int, read: Callable[[Path], T]) -> T:
        """Calls `read` with the folder of a model. If the folder vanished, tries the folder that it moved to."""
        folder = self._folders[index]
        try:
            return read(folder)
        except InputError:
            if self._moved is None or (folder / DESCRIPTION).is_file():
                raise
            now = self._moved(index)
            if now == folder or not (now / DESCRIPTION).is_file():
                raise
            self._folders[index] = now
            return self._with_folder(index, read)

    def _find(self, index: int) -> SubmapModel | None:
        """The model if it is in memory; waits if another thread is loading it."""
        while index in self._loading:
            self._changed.wait()
        if index not in self._loaded:
            return None
        self._loaded.move_to_end(index)
        return self._loaded[index]

    def _load_ahead(self, index: int) -> None:
        with self._changed:
            if index in self._loaded or index in self._hopeless or self._loading:
                return
            if not self._fits_beside_the_last(self._needed.get(index, 0)):
                return
            self._loading[index] = 0
        threading.Thread(target=self._run_ahead, args=(index,), name="load ahead").start()

    def _run_ahead(self, index: int) -> None:
        model = None
        try:
            needed = self._with_folder(index, memory_needed)
            with self._changed:
                self._needed[index] = needed
                fits = self._fits_beside_the_last(needed)
                if fits:
                    self._loading[index] = needed
                    self._unload_least_used(keep=1)
            if fits:
                model = self._with_folder(index, self._load)
        except Exception:
            # A request for this model will report the error. Loading ahead is optional, so it stays silent.
            with self._changed:
                self._hopeless.add(index)
        self._end(index, model, ahead=True)

    def _fits_beside_the_last(self, needed: int) -> bool:
        last = next(reversed(self._loaded.values()), None)
        kept = 0 if last is None else memory_of(last)
        return needed + kept + sum(self._loading.values()) <= self._budget

    def _end(self, index: int, model: SubmapModel | None, ahead: bool = False) -> None:
        with self._changed:
            del self._loading[index]
            if model is not None:
                last = next(reversed(self._loaded), index)
                self._loaded[index] = model
                if ahead:
                    self._loaded.move_to_end(last)  # the one in use stays the most recent
                self._unload_least_used(keep=1)
            self._changed.notify_all()

    def _unload_least_used(self, keep: int) -> None:
        """Unloads the least recently used models while the budget is exceeded, except the last `keep`."""
        while len(self._loaded) > keep and self._memory_in_use() > self._budget:
            self._loaded.popitem(last=False)

    def _memory_in_use(self) -> int:
        return sum(map(memory_of, self._loaded.values())) + sum(self._loading.values())

    def _distances(self, position: NDArray[np.floating]) -> NDArray[np.float64]:
        """(submaps,) meters to the nearest core camera of each submap."""
        asked, found = self._measured
        place = np.asarray(position, np.float64).tobytes()
        if asked != place:
            squares = np.sum((self._positions - position) ** 2, axis=1)
            found = np.asarray(np.sqrt(np.minimum.reduceat(squares, self._firsts)), np.float64)
            self._measured = place, found  # views at one position are usually requested one after the other
        return found


def _gray(model: SubmapModel) -> SubmapModel:
    """The parts that alpha, depth, and normals need."""
    gray = replace(model.gaussians, sh=np.zeros((len(model.gaussians), 1, 3), np.float32))
    return replace(model, gaussians=gray, background=None, texture=None, appearance=None)


def default_budget() -> int:
    """A quarter of the machine's memory. The rest is for kernels, the window, and the system."""
    import psutil

    return int(psutil.virtual_memory().total) // 4


def memory_of(model: SubmapModel) -> int:
    """Bytes of the model's arrays. The floor texture counts twice, because the renderer makes a packed copy when it is
    first drawn. Colors that depend on the position also count twice, because the last set is cached."""
    g = model.gaussians
    arrays = [*g.arrays, model.floor.heights]
    if model.background is not None:
        arrays += list(model.background.weights.values())
    if model.texture is not None:
        arrays += 2 * list(model.texture.levels)
    if model.appearance is not None:
        a = model.appearance
        arrays += [g.sh, a.features, *a.weights.values(), *a.embedding.weights.values()]
    return sum(a.nbytes for a in arrays)
