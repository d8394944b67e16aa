"""The modes that select.

By default, a click selects, a drag moves the selection, Ctrl and a drag select a box, and arrow keys nudge the
selection. The other modes select by a box or a lasso: Shift adds to the selection, Ctrl toggles.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable

import numpy as np
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QKeyEvent, QPainter, QPolygonF

from nvsim.graph.selection import GraphSelection
from nvsim_app.look import lengths
from nvsim_app.modes.mode import Mode, ModeContext, Pointer, area, dots, label, line
from nvsim_app.state import edit_commands
from nvsim_app.views.graph_surface import GraphSurface


def choose(
    context: ModeContext, pointer: Pointer, viewpoints: Iterable[str] = (), edges: Iterable[tuple[str, str]] = ()
) -> None:
    """Selects these items and deselects all others. With Shift, adds them; with Ctrl, toggles them."""
    found = GraphSelection(frozenset(viewpoints), frozenset(edges))
    now = context.editing.selection
    if pointer.toggles_selection:
        found = GraphSelection(now.viewpoints ^ found.viewpoints, now.edges ^ found.edges)
    elif pointer.adds_to_selection:
        found = GraphSelection(now.viewpoints | found.viewpoints, now.edges | found.edges)
    context.editing.select(found)


def select_at_pointer(context: ModeContext, pointer: Pointer) -> bool:
    """Selects the viewpoint, or else the edge, under the mouse pointer. Returns False if there is neither and no
    modifier key is pressed."""
    viewpoint = pointer.viewpoint
    if viewpoint is not None:
        choose(context, pointer, [viewpoint])
        return True
    edge = pointer.edge
    if edge is not None:
        choose(context, pointer, edges=[edge])
        return True
    return pointer.adds_to_selection or pointer.toggles_selection


NUDGE = 0.05  # meters
SERIES = 1.0  # seconds; arrow keys in quicker succession are one step of the history
_ARROWS = {
    Qt.Key.Key_Left: (-1.0, 0.0),
    Qt.Key.Key_Right: (1.0, 0.0),
    Qt.Key.Key_Up: (0.0, 1.0),
    Qt.Key.Key_Down: (0.0, -1.0),
}


class SelectMode(Mode):
    """Selects, moves, and nudges viewpoints."""

    name = "select"
    hint = (
        "Click selects (Shift adds, Ctrl toggles) · drag the selection to move it, arrow keys nudge it · "
        "Ctrl+drag selects a box · right click for more"
    )

    def __init__(self, context: ModeContext) -> None:
        super().__init__(context)
        self._box = BoxMode(context)
        self._moving: tuple[str, ...] = ()
        self._offset = np.zeros(3)
        self._now: Pointer | None = None
        self._nudged: tuple[frozenset[str], float] = (frozenset(), 0.0)  # the viewpoints and the time
        self._nudges = itertools.count()
        self._nudge = 0

    def click(self, pointer: Pointer) -> bool:
        return select_at_pointer(self.context, pointer)

    # Dragging --------------------------------------------------------------------------------------------------

    def takes_drag(self, start: Pointer) -> bool:
        if start.toggles_selection:
            return True  # Ctrl, because Shift moves the camera sideways
        viewpoint = start.viewpoint
        # Only selected viewpoints move, because a drag that turns the camera often starts on a viewpoint.
        if viewpoint not in self.context.editing.selection.viewpoints or not self.context.editing.writable:
            return False
        arrays = self.context.document.graph_arrays
        chosen = sorted(self.context.editing.selection.viewpoints, key=arrays.index.__getitem__)
        self._moving = (viewpoint, *(id for id in chosen if id != viewpoint))
        return True

    def drag(self, start: Pointer, now: Pointer) -> None:
        if not self._moving:
            self._box.drag(start, now)
            return
        self._offset, self._now = self._offset_to(now), now
        self.context.refresh()

    def end_drag(self, start: Pointer, now: Pointer) -> None:
        if not self._moving:
            self._box.end_drag(start, now)
            return
        offset, moved = self._offset_to(now), self._moving
        self.cancel()
        if offset.any():
            edit_commands.move(self.context.editing, moved, (float(offset[0]), float(offset[1]), float(offset[2])))

    def _offset_to(self, now: Pointer) -> np.ndarray:
        """(3,) offset in meters from the foot of the dragged viewpoint to the floor under the mouse pointer."""
        arrays = self.context.document.graph_arrays
        place = now.surface.floor_point(now.point)
        if place is None or self._moving[0] not in arrays.index:
            return np.zeros(3)
        offset = np.array(place) - arrays.feet[arrays.index[self._moving[0]]]
        if abs(offset[2]) < 0.05:
            offset[2] = 0.0  # heights this close count as one floor
        return offset

    def cancel(self) -> bool:
        was, self._moving, self._offset = bool(self._moving), (), np.zeros(3)
        self.context.refresh()
        return self._box.cancel() or was

    def hover(self, pointer: Pointer) -> bool:
        held = pointer.viewpoint or pointer.edge
        shape = Qt.CursorShape.PointingHandCursor if held is not None else Qt.CursorShape.ArrowCursor
        pointer.surface.widget.setCursor(shape)
        return False

    # Keys --------------------------------------------------------------------------------------------------------

    def key(self, event: QKeyEvent) -> bool:
        way = _ARROWS.get(Qt.Key(event.key()))
        chosen = self.context.editing.selection.viewpoints
        if way is None or not chosen:
            return False
        now, (same, last) = time.monotonic(), self._nudged
        if same != chosen or now - last > SERIES:
            self._nudge = next(self._nudges)
        self._nudged = chosen, now
        step = NUDGE * (10 if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 1)
        edit_commands.move(
            self.context.editing, sorted(chosen), (way[0] * step, way[1] * step, 0.0), merge=f"nudge {self._nudge}"
        )
        return True

    # Drawing -----------------------------------------------------------------------------------------------------

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        self._box.paint(painter, surface)
        if not self._moving:
            return
        arrays = self.context.document.graph_arrays
        rows = arrays.viewpoint_rows(self._moving)
        moving = np.zeros(len(arrays.ids), bool)
        moving[rows] = True
        touched = arrays.edges[moving[arrays.edges].any(axis=1)]
        feet = arrays.feet + moving[:, None] * self._offset
        line(painter, surface, feet[touched[:, 0]], feet[touched[:, 1]])
        dots(painter, surface, feet[rows])
        if self._now is not None and self._now.surface is surface:
            what = "" if len(rows) == 1 else f"{len(rows):,} viewpoints "
            label(painter, self._now.point, f"move {what}{lengths.length(float(np.linalg.norm(self._offset)))}")


class _ShapeMode(Mode):
    """Selects the items inside a shape that is dragged."""

    cursor = Qt.CursorShape.CrossCursor

    def click(self, pointer: Pointer) -> bool:
        return select_at_pointer(self.context, pointer)

    def takes_drag(self, start: Pointer) -> bool:
        return True


class BoxMode(_ShapeMode):
    """Selects the viewpoints and edges in a box."""

    name = "box"
    hint = "Drag a box to select its contents · Shift adds, Ctrl toggles · Esc returns to Select"
    _box: tuple[GraphSurface, QRectF] | None = None

    def drag(self, start: Pointer, now: Pointer) -> None:
        self._box = (start.surface, QRectF(start.point, now.point).normalized())
        self.context.refresh()

    def end_drag(self, start: Pointer, now: Pointer) -> None:
        box = QRectF(start.point, now.point).normalized()
        self.cancel()
        corners = [box.topLeft(), box.topRight(), box.bottomRight(), box.bottomLeft()]
        choose(self.context, now, start.surface.polygon_selection(corners))

    def cancel(self) -> bool:
        was, self._box = self._box is not None, None
        self.context.refresh()
        return was

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        if self._box is not None and self._box[0] is surface:
            area(painter, self._box[1])


class LassoMode(_ShapeMode):
    """Selects the viewpoints and edges inside a freehand line."""

    name = "lasso"
    hint = "Draw a line around the items to select · Shift adds, Ctrl toggles · Esc returns to Select"
    _surface: GraphSurface | None = None
    _way: tuple[QPointF, ...] = ()

    def drag(self, start: Pointer, now: Pointer) -> None:
        if self._surface is None:
            self._way = (start.point,)
        self._surface = start.surface
        self._way = (*self._way, now.point)
        self.context.refresh()

    def end_drag(self, start: Pointer, now: Pointer) -> None:
        way = (*self._way, now.point)
        self.cancel()
        choose(self.context, now, start.surface.polygon_selection(way))

    def cancel(self) -> bool:
        was, self._surface, self._way = self._surface is not None, None, ()
        self.context.refresh()
        return was

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        if self._surface is surface and len(self._way) > 1:
            area(painter, QPolygonF(list(self._way)))
