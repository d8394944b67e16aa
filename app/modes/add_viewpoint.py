"""The mode that adds viewpoints with a click.

A click on the floor adds a viewpoint there, a click on a frame adds one at the frame's camera, and a click on an edge
splits the edge. Alt turns snapping off. Shift connects the new viewpoint to the selected one, so that several clicks
make a chain.
"""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QPainter

from app.modes.ink import dots, label, line
from app.modes.mode import Mode, Pointer
from app.state import edit_commands
from app.views.graph_surface import GraphSurface
from nvsim.graph.selection import GraphSelection


class AddViewpointMode(Mode):
    """Adds viewpoints on the floor, at frames, or on edges."""

    name = "add_viewpoint"
    hint = (
        "Click the floor to add a viewpoint · Shift connects it to the selected one · Alt: no snap to frames and edges"
    )
    cursor = Qt.CursorShape.CrossCursor
    _ghost: tuple[GraphSurface, QPointF, np.ndarray, str] | None = None

    def click(self, pointer: Pointer) -> bool:
        editing = self.context.editing
        there = pointer.viewpoint
        if there is not None:
            # A click on an existing viewpoint selects it, so that the chain can continue from there.
            editing.select(GraphSelection(frozenset({there})))
            return True
        join = self._joined() if pointer.adds else None
        frame, edge = self._snapped(pointer)
        place = pointer.surface.floor_point(pointer.point)
        if frame is not None:
            x, y, z = (float(v) for v in self.context.document.trajectory.positions[frame])
            edit_commands.add_viewpoint(editing, (x, y, z), join=join)
        elif edge is not None:
            edit_commands.split_edge(editing, edge, self._share(edge, place))
        elif place is None:
            editing.refuse("There is no floor under the mouse pointer.")
        else:
            edit_commands.add_viewpoint_on_floor(editing, place, join=join)
        return True

    def hover(self, pointer: Pointer) -> bool:
        pointer.surface.widget.setCursor(self.cursor)
        frame, edge = self._snapped(pointer)
        place = pointer.surface.floor_point(pointer.point)
        if pointer.viewpoint is not None:
            words = "select this viewpoint"
        elif frame is not None:
            words = "add a viewpoint at this frame's camera"
            place = tuple(
                self.context.document.trajectory.positions[frame]
                - [0.0, 0.0, edit_commands.eye_height(self.context.editing)]
            )
        elif edge is not None:
            words = "split this edge with a viewpoint"
        elif place is None:
            words = "no floor here"
        elif pointer.adds and self._joined() is not None:
            words = "add a viewpoint and connect it"
        else:
            words = "add a viewpoint"
        self._ghost = None if place is None else (pointer.surface, pointer.point, np.array(place), words)
        self._joins = pointer.adds
        self.context.refresh()
        return True

    _joins = False

    def away(self) -> None:
        self._ghost = None

    def cancel(self) -> bool:
        self._ghost = None
        self.context.refresh()
        return False

    def leave(self) -> None:
        self.cancel()

    def _joined(self) -> str | None:
        chosen = self.context.editing.selection.viewpoints
        return next(iter(chosen)) if len(chosen) == 1 else None

    def _snapped(self, pointer: Pointer) -> tuple[int | None, tuple[str, str] | None]:
        if pointer.free:
            return None, None
        edge = pointer.edge
        if edge is not None and not pointer.adds:
            return None, edge
        return pointer.surface.pick_frame(pointer.point), None

    def _share(self, edge: tuple[str, str], place: tuple[float, float, float] | None) -> float:
        """Position along the edge, from 0.05 to 0.95."""
        arrays = self.context.document.graph_arrays
        a, b = (arrays.feet[arrays.index[end]] for end in edge)
        if place is None:
            return 0.5
        way = b - a
        return float(np.clip((np.array(place) - a) @ way / max(float(way @ way), 1e-9), 0.05, 0.95))

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        if self._ghost is None or self._ghost[0] is not surface:
            return
        _, point, place, words = self._ghost
        join = self._joined() if self._joins else None
        arrays = self.context.document.graph_arrays
        if join is not None and join in arrays.index:
            line(painter, surface, arrays.feet[arrays.index[join]], place)
        dots(painter, surface, place)
        label(painter, point, words)
