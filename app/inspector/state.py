"""What the inspector looks at: the directions of the selected viewpoint, and the one that is pointed at. The panorama,
the list, the 3D view and the map render from it."""

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
    """changed(): other directions, or other words about them; pointed(): another one is pointed at."""

    changed = Signal()
    pointed = Signal()

    def __init__(self, document: Document, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._preview: MappingConfig | None = None
        self.directions: tuple[Direction, ...] = ()
        self.viewpoint: str | None = None
        self.neighbours: tuple[tuple[str, NDArray[np.float64]], ...] = ()
        """Where its edges lead: id and (3,) foot, metres, world."""
        self.eye: NDArray[np.float64] = np.zeros(3)
        self._pointed: tuple[str, int] | None = None
        document.selectionChanged.connect(self.refresh)
        document.contentsChanged.connect(self._on_contents)
        document.graphChanged.connect(self._on_edit)
        self.refresh()

    @property
    def config(self) -> MappingConfig:
        """The thresholds that the words are about: those tried out, or the project's."""
        return self._preview or self._document.contents.thresholds

    def name_of(self, id: str) -> str:
        """A viewpoint as the window names it."""
        return short_id(self._document.graph, id)

    def try_out(self, config: MappingConfig | None) -> None:
        """Speaks of other thresholds; None: of the project's again."""
        if config != self._preview:
            self._preview = config
            self.refresh()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "graph" in parts:
            self.refresh()

    def _on_edit(self, change: Difference) -> None:
        self.refresh()

    def refresh(self) -> None:
        """Reads the directions of what is selected."""
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
        """The direction that is pointed at."""
        return next((d for d in self.directions if d.key == self._pointed), None)

    def point(self, direction: Direction | None) -> None:
        key = None if direction is None else direction.key
        if key != self._pointed:
            self._pointed = key
            self.pointed.emit()
