"""The cleaning of a splat before it is applied: the Gaussians that will be removed, the selected ones, the history."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Signal

from nvsim.geometry.camera import Camera
from nvsim.scene_import.cleaning import Reason
from nvsim_app.drawing.marked_model import MARKS, Marks
from nvsim_app.painting.picking import NEAR, within_polygon
from nvsim_app.state.side_work import RemovableGaussians

FARTHEST = 1000.0
"""Meters from the camera to selected Gaussians, at most, if the user sets no smaller distance."""
_numbers = itertools.count(1)


def rows_in_outline(
    camera: Camera, means: NDArray[np.float32], outline: NDArray[np.float64], reach: float = FARTHEST
) -> NDArray[np.int64]:
    """(M,) rows of the Gaussians with centers `means` (N, 3), meters, world, that project into the polygon `outline`
    (K, 2) of pixels of `camera`, also those behind others, up to a depth of `reach` meters."""
    pixels, depths = camera.project(means)
    low, high = outline.min(axis=0), outline.max(axis=0)
    rows = np.flatnonzero((depths > NEAR) & (depths <= reach) & ((pixels >= low) & (pixels <= high)).all(axis=1))
    return rows[within_polygon(pixels[rows], outline)]


class SplatCleaning(QObject):
    """Edits which Gaussians of `found` will be removed. At first: those that are removed now, or else all candidates.

    changed(): the Gaussians to remove, or the selected ones, changed.
    """

    changed = Signal()

    def __init__(self, found: RemovableGaussians) -> None:
        super().__init__()
        self.found = found
        self.selected = np.zeros(len(found.means), bool)
        self.removed = found.removed.copy()
        if not self.removed.any():
            self.removed |= np.any([self.selected, *found.candidates.values()], axis=0)
        self._past: list[NDArray[np.uint8]] = []
        self._future: list[NDArray[np.uint8]] = []

    @property
    def edited(self) -> bool:
        """Whether applying changes the project."""
        return not np.array_equal(self.removed, self.found.removed)

    def count(self, reason: Reason) -> tuple[int, int]:
        """The number of candidates with this reason that will be removed, and of all with this reason."""
        rows = self.found.candidates[reason]
        return int((rows & self.removed).sum()), int(rows.sum())

    # Editing ---------------------------------------------------------------------------------------------------

    def select(self, rows: NDArray[np.int64], adds: bool = False, toggles: bool = False) -> None:
        """Selects the Gaussians `rows` (M,) and no others; or adds them to the selection, or toggles them."""
        selected = self.selected.copy() if adds or toggles else np.zeros_like(self.selected)
        selected[rows] = ~selected[rows] if toggles else True
        self._change(self.removed, selected)

    def remove_selected(self) -> None:
        self._change(self.removed | self.selected, np.zeros_like(self.selected))

    def keep_selected(self) -> None:
        self._change(self.removed & ~self.selected, np.zeros_like(self.selected))

    def set_reason(self, reason: Reason, on: bool) -> None:
        """Removes or keeps all candidates with this reason."""
        rows = self.found.candidates[reason]
        self._change(self.removed | rows if on else self.removed & ~rows, self.selected)

    def keep_all(self) -> None:
        self._change(np.zeros_like(self.removed), np.zeros_like(self.selected))

    def _change(self, removed: NDArray[np.bool_], selected: NDArray[np.bool_]) -> None:
        if np.array_equal(removed, self.removed) and np.array_equal(selected, self.selected):
            return
        self._past.append(self._state())
        self._future.clear()
        self.removed, self.selected = removed, selected
        self.changed.emit()

    # History ---------------------------------------------------------------------------------------------------

    def undo(self) -> None:
        if self._past:
            self._future.append(self._state())
            self._restore(self._past.pop())

    def redo(self) -> None:
        if self._future:
            self._past.append(self._state())
            self._restore(self._future.pop())

    def _state(self) -> NDArray[np.uint8]:
        """Both sets, 2 bits per Gaussian."""
        return np.packbits([self.removed, self.selected], axis=1)

    def _restore(self, state: NDArray[np.uint8]) -> None:
        self.removed, self.selected = np.unpackbits(state, axis=1, count=len(self.removed)).astype(bool)
        self.changed.emit()

    # Drawing ---------------------------------------------------------------------------------------------------

    def marks(self, hide: bool) -> Marks:
        """The colors of the Gaussians to remove and of the selected ones. With `hide`, those to remove are hidden."""
        codes = np.where(self.removed, np.uint8(MARKS.index("by hand")), np.uint8(255))
        for reason, rows in self.found.candidates.items():
            codes[rows & self.removed] = MARKS.index(reason)
        codes[self.selected] = MARKS.index("selected")
        if hide:
            codes[self.removed] = MARKS.index("hidden")
        marked = np.flatnonzero(codes != 255).astype(np.int32)
        return Marks(next(_numbers), marked, codes[marked])
