"""The state of the window: what the project holds and what is selected. Views render from it and own nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Signal

from app.graph_arrays import GraphArrays, TrajectoryArrays
from app.jobs.queue import JobQueue
from app.loading import PARTS, Contents
from nvsim.graph.types import Viewpoint


@dataclass(frozen=True)
class Selection:
    """At most one thing: a viewpoint id, the index of a frame, or the index of a submap."""

    viewpoint: str | None = None
    frame: int | None = None
    submap: int | None = None

    def __bool__(self) -> bool:
        return self != Selection()


class Document(QObject):
    """projectChanged() when another project takes the place of this one, before its parts are announced;
    contentsChanged(frozenset of names from loading.PARTS); selectionChanged()."""

    projectChanged = Signal()
    contentsChanged = Signal(object)
    selectionChanged = Signal()

    def __init__(self, path: Path | None = None, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._contents = Contents(path)
        self._selection = Selection()
        self.jobs: JobQueue | None = None  # of the open project, where a window shows it
        self.graph_arrays = GraphArrays()
        self.trajectory = TrajectoryArrays()

    @property
    def contents(self) -> Contents:
        return self._contents

    @property
    def path(self) -> Path | None:
        return self._contents.path

    @property
    def project(self) -> Path | None:
        """The folder of the open project; None for a splat file."""
        return None if self._contents.outline is not None or (self.path and self.path.is_file()) else self.path

    @property
    def selection(self) -> Selection:
        return self._selection

    def set_contents(self, contents: Contents) -> None:
        """Takes a newly read state; says which parts differ by identity."""
        before, self._contents = self._contents, contents
        changed = frozenset(part for part in PARTS if getattr(before, part) is not getattr(contents, part))
        if "graph" in changed:
            self.graph_arrays = GraphArrays.of(contents.graph)
        if changed & {"capture", "submaps"}:
            self.trajectory = TrajectoryArrays.of(contents.capture, contents.submaps)
        if before.path != contents.path:
            self._selection = Selection()
            self.projectChanged.emit()
            self.selectionChanged.emit()
        if not changed:
            return
        self.contentsChanged.emit(changed)
        if not self._holds(self._selection):
            self.select()

    def select(self, *, viewpoint: str | None = None, frame: int | None = None, submap: int | None = None) -> None:
        """Selects one thing, or nothing."""
        wanted = Selection(viewpoint, frame, submap)
        if wanted != self._selection and self._holds(wanted):
            self._selection = wanted
            self.selectionChanged.emit()

    def _holds(self, selection: Selection) -> bool:
        if selection.viewpoint is not None:
            return selection.viewpoint in self.graph_arrays.index
        if selection.frame is not None:
            return 0 <= selection.frame < len(self.trajectory.positions)
        if selection.submap is not None:
            return any(s.index == selection.submap for s in self._contents.submaps)
        return True

    @property
    def selected_viewpoint(self) -> Viewpoint | None:
        graph, id = self._contents.graph, self._selection.viewpoint
        return None if graph is None or id is None else graph.viewpoints.get(id)

    @property
    def selected_point(self) -> NDArray[np.float64] | None:
        """(3,) metres, world: the middle of what is selected."""
        viewpoint = self.selected_viewpoint
        if viewpoint is not None:
            return np.array(viewpoint.position)
        if self._selection.frame is not None:
            return self.trajectory.positions[self._selection.frame]
        for submap in self._contents.submaps:
            if submap.index == self._selection.submap:
                return submap.positions.mean(axis=0)
        return None

    @property
    def extent(self) -> NDArray[np.float64]:
        """(N, 3) every position that is known: viewpoints and frames, or the outline of a splat file; may be empty."""
        outline = self._contents.outline
        known = [self.graph_arrays.positions, self.trajectory.positions]
        return np.concatenate(known if outline is None else [*known, outline])
