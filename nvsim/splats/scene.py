"""The scene model: all submap models of a building, of which few need to be in memory at once."""

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
from nvsim.submaps.storeys import storeys_of
from nvsim.submaps.types import Submap

T = TypeVar("T")
GIBIBYTE = 1 << 30
NEAR_BORDER = 3.0
"""Metres by which the second nearest submap may be farther than the nearest to be loaded ahead: the eye is then at most
half of this from the border between them."""


class SceneModel:
    """Answers which submap model draws a view from a position. Models are loaded when first asked for; before that, the
    least recently used are let go until the new one fits the budget. The one asked for is loaded even when it alone
    exceeds it. Thread-safe; a load holds nobody up who asks for another model.

    submaps         all of them, whether trained or not
    folders         where the model of each is, None for one that is not trained
    memory_budget   bytes of arrays; None takes `default_budget`
    ahead           whether `model_at` loads the next submap in a thread of its own when the position is near its
                    border, if it fits without the one in use being let go
    moved           asked for the folder of a submap's model when the known one vanished: its training has ended, or
                    another model took its place
    colours         whether the models keep theirs; else they are grey, without background, in a fifth of the memory

    Raises ValueError when the lists do not match or no submap has a model.
    """

    def __init__(
        self,
        submaps: Sequence[Submap],
        folders: Sequence[Path | None],
        memory_budget: int | None = None,
        ahead: bool = True,
        moved: Callable[[int], Path] | None = None,
        colours: bool = True,
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
        self._colours = colours
        self._positions = np.concatenate([s.positions for s in self._submaps])
        self._firsts = np.cumsum([0, *(len(s.positions) for s in self._submaps[:-1])])
        self._frames = np.concatenate([s.core for s in self._submaps]).astype(np.int64)
        self._trained = [np.asarray(s.frames, np.int64) for s in self._submaps]
        self._tree: Any = None  # of the positions, once it is asked for
        self._measured = b"", np.zeros(0)  # the place last asked about, and its distances
        self._asking = threading.Lock()  # held by the one thread that loads what was asked for
        self._changed = threading.Condition()  # guards all that follows
        self._loaded: OrderedDict[int, SubmapModel] = OrderedDict()
        self._loading: dict[int, int] = {}  # index -> bytes set aside for it
        self._needed: dict[int, int] = {}  # index -> bytes, of those that were looked at to be loaded ahead
        self._hopeless: set[int] = set()  # what could not be loaded ahead; asking for it says why

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
        """Bytes of the models in memory and of those being loaded."""
        with self._changed:
            return self._taken()

    def nearest(self, position: NDArray[np.floating]) -> int:
        """Index of the submap, among those with a model, with the core camera nearest to `position` (3,) (paper
        Algorithm 1, line 4)."""
        return self._submaps[int(np.argmin(self._distances(position)))].index

    def second(self, position: NDArray[np.floating]) -> int | None:
        """Besides `nearest`, the submap with the nearest core camera among those that were trained on the frame nearest
        to `position` (3,) as well: where the overlap of two submaps lies. None where there is none. That of a stair has
        no opinion on the floors that it joins: its frames look along the stair."""
        if len(self._submaps) == 1:
            return None
        frame = self._nearest_frames(np.asarray(position)[None])[0]
        for i in np.argsort(self._distances(position), kind="stable")[1:]:
            if frame in self._trained[i] and not self._on_stairs[i]:
                return self._submaps[i].index
        return None

    @cached_property
    def _on_stairs(self) -> list[bool]:
        """Of each submap, whether most of its core climbs from a storey to another."""
        climbs = storeys_of(self._positions).part % 2 == 1
        return [bool(np.mean(part) > 0.5) for part in np.split(climbs, self._firsts[1:])]

    def trained_at(self, index: int, positions: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) whether a submap was trained on the frame nearest to each of `positions` (N, 3)."""
        return self._is_trained[index][self._nearest_frames(positions)]

    @cached_property
    def _is_trained(self) -> dict[int, NDArray[np.bool_]]:
        """Of each submap, whether it was trained on each frame (frames,)."""
        count = 1 + max(int(frames.max()) for frames in (self._frames, *self._trained))
        found = {submap.index: np.zeros(count, bool) for submap in self._submaps}
        for submap, frames in zip(self._submaps, self._trained, strict=True):
            found[submap.index][frames] = True
        return found

    def _nearest_frames(self, positions: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N,) the frames nearest to places (N, 3)."""
        if self._tree is None:
            from scipy.spatial import cKDTree

            self._tree = cKDTree(self._positions)
        return np.asarray(self._frames[self._tree.query(positions)[1]])

    def model_at(self, position: NDArray[np.floating]) -> tuple[int, SubmapModel]:
        """Index and model of `nearest`. Raises InputError when its files cannot be read."""
        distances = self._distances(position)
        order = np.argsort(distances, kind="stable")[:2]
        index = self._submaps[int(order[0])].index
        model = self.model(index)
        if self._ahead and len(order) > 1 and distances[order[1]] - distances[order[0]] < NEAR_BORDER:
            self._load_ahead(self._submaps[int(order[1])].index)
        return index, model

    def model(self, index: int) -> SubmapModel:
        """The model of a submap. Raises KeyError when it has none, InputError when its files cannot be read."""
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
                self._let_go(keep=0)
                # What is being loaded ahead cannot be let go before it is there.
                while self._taken() > self._budget and len(self._loading) > 1:
                    self._changed.wait()
                    self._let_go(keep=0)
            model = None
            try:
                model = self._with_folder(index, self._load)
            finally:
                self._end(index, model)
            return model

    def _load(self, folder: Path) -> SubmapModel:
        model = load_model(folder)
        return model if self._colours else _grey(model)

    def _with_folder(self, index: int, read: Callable[[Path], T]) -> T:
        """What `read` makes of the folder of a model, and of the one that it moved to when it vanishes meanwhile."""
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
        """The model if it is in memory, or on its way there in another thread."""
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
                    self._let_go(keep=1)
            if fits:
                model = self._with_folder(index, self._load)
        except Exception:
            # Whoever asks for this model is told what is wrong with it; a guess bothers nobody.
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
                self._let_go(keep=1)
            self._changed.notify_all()

    def _let_go(self, keep: int) -> None:
        """Lets go of the least recently used while the budget is exceeded, but for the last `keep`."""
        while len(self._loaded) > keep and self._taken() > self._budget:
            self._loaded.popitem(last=False)

    def _taken(self) -> int:
        return sum(map(memory_of, self._loaded.values())) + sum(self._loading.values())

    def _distances(self, position: NDArray[np.floating]) -> NDArray[np.float64]:
        """(submaps,) metres to the nearest core camera of each."""
        asked, found = self._measured
        place = np.asarray(position, np.float64).tobytes()
        if asked != place:
            squares = np.sum((self._positions - position) ** 2, axis=1)
            found = np.asarray(np.sqrt(np.minimum.reduceat(squares, self._firsts)), np.float64)
            self._measured = place, found  # the views of one place are asked for one after the other
        return found


def _grey(model: SubmapModel) -> SubmapModel:
    """What alpha, depth and normals are drawn from."""
    grey = replace(model.gaussians, sh=np.zeros((len(model.gaussians), 1, 3), np.float32))
    return replace(model, gaussians=grey, background=None, texture=None, appearance=None)


def default_budget() -> int:
    """A quarter of the machine's memory: beside the models, kernels, the window and the system want their share."""
    import psutil

    return int(psutil.virtual_memory().total) // 4


def memory_of(model: SubmapModel) -> int:
    """Bytes of the model's arrays. The floor texture counts twice, since the kernels pack theirs when it is first
    drawn, and so do colours that depend on the position, which are kept for the last one."""
    g = model.gaussians
    arrays = [g.means, g.log_scales, g.quats, g.opacity_logits, g.sh, model.floor.heights]
    if model.background is not None:
        arrays += list(model.background.weights.values())
    if model.texture is not None:
        arrays += 2 * list(model.texture.levels)
    if model.appearance is not None:
        a = model.appearance
        arrays += [g.sh, a.features, *a.weights.values(), *a.embedding.weights.values()]
    return sum(a.nbytes for a in arrays)
