"""The mode that adds edges: click two viewpoints, or drag from one to the other. With Shift, the next edge starts at
the second viewpoint.

While the mouse is over the second viewpoint, the line shows whether the evidence supports the edge.
"""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QPainter

from app.layers.labels import short_ids
from app.look import colors, lengths
from app.modes.ink import GHOST, dots, label, line
from app.modes.mode import Mode, Pointer
from app.state import edit_commands
from app.state.way_between import way_between
from app.views.graph_surface import GraphSurface
from nvsim.graph.selection import GraphSelection
from nvsim.mapping.explanation.between import Between

_INKS = {1: colors.OPEN, 0: GHOST, -1: colors.BLOCKED}


class AddEdgeMode(Mode):
    """Adds an edge between two viewpoints."""

    name = "add_edge"
    hint = "Click two viewpoints to connect them, or drag from one to the other · Shift continues from the second"
    cursor = Qt.CursorShape.CrossCursor
    _start: str | None = None
    _now: Pointer | None = None
    _key: tuple[object, ...] | None = None  # inputs of the cached result
    _between: Between | None = None

    def enter(self) -> None:
        chosen = self.context.editing.selection.viewpoints
        self._start = next(iter(chosen)) if len(chosen) == 1 else None

    def click(self, pointer: Pointer) -> bool:
        there = pointer.viewpoint
        if there is None:
            self.context.editing.refuse("An edge connects two viewpoints. Click a viewpoint.")
        elif self._held is None:
            self._begin(there)
        else:
            self._join(there, pointer.adds)
        return True

    def takes_drag(self, start: Pointer) -> bool:
        there = start.viewpoint
        if there is not None:
            self._begin(there)
        return there is not None

    def drag(self, start: Pointer, now: Pointer) -> None:
        self.hover(now)

    def drop(self, start: Pointer, now: Pointer) -> None:
        there = now.viewpoint
        if there is None:
            self.cancel()
            self.context.editing.refuse("The edge must end at a viewpoint.")
        elif there != self._held:
            self._join(there, now.adds)

    def hover(self, pointer: Pointer) -> bool:
        pointer.surface.widget.setCursor(self.cursor)
        self._now = pointer
        self.context.refresh()
        return True

    def away(self) -> None:
        self._now = None

    def cancel(self) -> bool:
        was, self._start, self._now = self._held is not None, None, None
        self.context.refresh()
        return was

    def leave(self) -> None:
        self.cancel()

    @property
    def _held(self) -> str | None:
        """The first viewpoint, if it still exists."""
        return self._start if self._start in self.context.document.graph_arrays.index else None

    def _begin(self, id: str) -> None:
        self._start = id
        self.context.editing.select(GraphSelection(frozenset({id})))
        self.context.refresh()

    def _join(self, there: str, go_on: bool) -> None:
        start = self._held
        assert start is not None  # checked by the callers
        if there == start:
            self.cancel()
            return
        edit_commands.add_edge(self.context.editing, start, there)
        self._start = there if go_on else None
        self.context.refresh()

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        start, now = self._held, self._now
        arrays = self.context.document.graph_arrays
        if start is not None:
            dots(painter, surface, arrays.feet[arrays.index[start]], radius=7.0)
        if now is None or now.surface is not surface:
            return
        there = now.viewpoint
        if there is not None:
            dots(painter, surface, arrays.feet[arrays.index[there]], radius=9.0, filled=False)
        if start is None:
            label(painter, now.point, "start an edge" if there is not None else "click a viewpoint")
            return
        foot = arrays.feet[arrays.index[start]]
        end = arrays.feet[arrays.index[there]] if there is not None else now.surface.floor_point(now.point)
        if end is None:
            return
        found = None if there is None else self._found(start, there)
        ink = GHOST if found is None else _INKS[found.speaks]
        line(painter, surface, foot, np.array(end), ink)
        away = lengths.length(float(np.linalg.norm(np.array(end) - foot)))
        label(painter, QPointF(now.point), f"connect, {away}" if there is not None else away)
        if found is not None:
            label(painter, now.point + QPointF(0, 24), short_ids(self.context.document.graph, found.sentence), ink)

    def _found(self, start: str, there: str) -> Between | None:
        """The evidence between the two viewpoints, computed once for each pair and graph."""
        document = self.context.document
        key = (document.graph, document.contents, start, there)
        if self._key is None or any(a is not b for a, b in zip(self._key, key, strict=True)):
            self._key, self._between = key, way_between(document, start, there)
        return self._between
