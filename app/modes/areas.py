"""The modes that select by an area: a box or a lasso. Shift adds to the selection, Ctrl toggles."""

from __future__ import annotations

from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QPainter, QPolygonF

from app.modes.ink import area
from app.modes.mode import Mode, Pointer
from app.modes.picking import choose, choose_what_is_under
from app.views.graph_surface import GraphSurface


class BoxMode(Mode):
    """Selects the viewpoints and edges in a box."""

    name = "box"
    hint = "Drag a box to select its contents · Shift adds, Ctrl toggles · Esc returns to Select"
    cursor = Qt.CursorShape.CrossCursor
    _box: tuple[GraphSurface, QRectF] | None = None

    def click(self, pointer: Pointer) -> bool:
        return choose_what_is_under(self.context, pointer)

    def takes_drag(self, start: Pointer) -> bool:
        return True

    def drag(self, start: Pointer, now: Pointer) -> None:
        self._box = (start.surface, QRectF(start.point, now.point).normalized())
        self.context.refresh()

    def drop(self, start: Pointer, now: Pointer) -> None:
        box = QRectF(start.point, now.point).normalized()
        self.cancel()
        corners = [box.topLeft(), box.topRight(), box.bottomRight(), box.bottomLeft()]
        choose(self.context, now, start.surface.polygon_selection(corners))

    def cancel(self) -> bool:
        was, self._box = self._box is not None, None
        self.context.refresh()
        return was

    leave = cancel  # type: ignore[assignment]

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        if self._box is not None and self._box[0] is surface:
            area(painter, self._box[1])


class LassoMode(Mode):
    """Selects the viewpoints and edges inside a freehand line."""

    name = "lasso"
    hint = "Draw a line around the items to select · Shift adds, Ctrl toggles · Esc returns to Select"
    cursor = Qt.CursorShape.CrossCursor
    _surface: GraphSurface | None = None
    _way: tuple[QPointF, ...] = ()

    def click(self, pointer: Pointer) -> bool:
        return choose_what_is_under(self.context, pointer)

    def takes_drag(self, start: Pointer) -> bool:
        return True

    def drag(self, start: Pointer, now: Pointer) -> None:
        if self._surface is None:
            self._way = (start.point,)
        self._surface = start.surface
        self._way = (*self._way, now.point)
        self.context.refresh()

    def drop(self, start: Pointer, now: Pointer) -> None:
        way = (*self._way, now.point)
        self.cancel()
        choose(self.context, now, start.surface.polygon_selection(way))

    def cancel(self) -> bool:
        was, self._surface, self._way = self._surface is not None, None, ()
        self.context.refresh()
        return was

    leave = cancel  # type: ignore[assignment]

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        if self._surface is surface and len(self._way) > 1:
            area(painter, QPolygonF(list(self._way)))
