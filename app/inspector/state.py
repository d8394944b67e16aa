"""The state of the inspector: the directions of the selected viewpoint and the highlighted one. The panorama, the list,
the 3D view, and the map show it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QObject, Signal

from app.layers.labels import short_id
from app.state.directions import Direction, directions
from app.state.document import Document
from nvsim.graph.difference import Difference
from nvsim.mapping.config import MappingConfig


class Inspection(QObject):
    """The directions of the selected viewpoint.

    changed()   the directions or their explanations changed
    pointed()   another direction is highlighted
    """

    changed = Signal()
    pointed = Signal()

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._preview: MappingConfig | None = None
        self.directions: tuple[Direction, ...] = ()
        self.viewpoint: str | None = None
        self.neighbours: tuple[tuple[str, NDArray[np.float64]], ...] = ()
        """The neighbors of the viewpoint: id and floor point (3,) in meters, world."""
        self.eye: NDArray[np.float64] = np.zeros(3)
        self._pointed: tuple[str, int] | None = None
        document.selectionChanged.connect(self.refresh)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._on_edit)
        self.refresh()

    @property
    def config(self) -> MappingConfig:
        """The thresholds of the explanations: those of the preview, else those of the project."""
        return self._preview or self._document.contents.thresholds

    def name_of(self, id: str) -> str:
        """The short name of a viewpoint in the window."""
        return short_id(self._document.graph, id)

    def try_out(self, config: MappingConfig | None) -> None:
        """Explains the directions with other thresholds; None restores those of the project."""
        if config != self._preview:
            self._preview = config
            self.refresh()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "graph" in parts:
            self.refresh()

    def _on_edit(self, change: Difference) -> None:
        self.refresh()

    def refresh(self) -> None:
        """Updates the directions from the selected viewpoint."""
        viewpoint, graph = self._document.selected_viewpoint, self._document.graph
        if viewpoint is None or graph is None:
            self.viewpoint, self.directions, self.neighbours = None, (), ()
        else:
            self.viewpoint, self.eye = viewpoint.id, np.array(viewpoint.position)
            arrays = self._document.graph_arrays
            self.directions = directions(graph, arrays, viewpoint.id, self.config)
            self.neighbours = tuple((id, arrays.feet[arrays.index[id]]) for id in graph.neighbours(viewpoint.id))
        if self.current is None:
            self._pointed = None
        self.changed.emit()

    @property
    def current(self) -> Direction | None:
        """The highlighted direction, None if there is none."""
        return next((d for d in self.directions if d.key == self._pointed), None)

    def point(self, direction: Direction | None) -> None:
        key = None if direction is None else direction.key
        if key != self._pointed:
            self._pointed = key
            self.pointed.emit()
