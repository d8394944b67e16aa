"""The modes that add edges and viewpoints.

Edges: click two viewpoints, or drag from one to the other. With Shift, the next edge starts at the second viewpoint.
While the mouse is over the second viewpoint, the line shows whether the evidence supports the edge.

Viewpoints: a click on the floor adds a viewpoint there, a click on a frame adds one at the frame's camera, and a click
on an edge splits the edge. Alt turns snapping off. Shift connects the new viewpoint to the selected one, so that
several clicks make a chain.
"""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QPainter

from nvsim.graph.selection import GraphSelection
from nvsim.mapping.explanation.path_explanation import PathExplanation
from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors, lengths
from nvsim_app.modes.mode import GHOST, Mode, Pointer, dots, label, line
from nvsim_app.state import edit_commands
from nvsim_app.state.directions import path_between
from nvsim_app.views.graph_surface import GraphSurface

_INKS = {1: colors.OPEN, 0: GHOST, -1: colors.BLOCKED}


class AddEdgeMode(Mode):
    """Adds an edge between two viewpoints."""

    name = "add_edge"
    hint = "Click two viewpoints to connect them, or drag from one to the other · Shift continues from the second"
    cursor = Qt.CursorShape.CrossCursor
    _start: str | None = None
    _now: Pointer | None = None
    _key: tuple[object, ...] | None = None  # inputs of the cached result
    _between: PathExplanation | None = None

    def enter(self) -> None:
        chosen = self.context.editing.selection.viewpoints
        self._start = next(iter(chosen)) if len(chosen) == 1 else None

    def click(self, pointer: Pointer) -> bool:
        there = pointer.viewpoint
        if there is None:
            self.context.editing.refuse("An edge connects two viewpoints. Click a viewpoint.")
        elif self._existing_start is None:
            self._begin(there)
        else:
            self._join(there, pointer.adds_to_selection)
        return True

    def takes_drag(self, start: Pointer) -> bool:
        there = start.viewpoint
        if there is not None:
            self._begin(there)
        return there is not None

    def drag(self, start: Pointer, now: Pointer) -> None:
        self.hover(now)

    def end_drag(self, start: Pointer, now: Pointer) -> None:
        there = now.viewpoint
        if there is None:
            self.cancel()
            self.context.editing.refuse("The edge must end at a viewpoint.")
        elif there != self._existing_start:
            self._join(there, now.adds_to_selection)

    def hover(self, pointer: Pointer) -> bool:
        pointer.surface.widget.setCursor(self.cursor)
        self._now = pointer
        self.context.refresh()
        return True

    def on_pointer_left(self) -> None:
        self._now = None

    def cancel(self) -> bool:
        was, self._start, self._now = self._existing_start is not None, None, None
        self.context.refresh()
        return was

    @property
    def _existing_start(self) -> str | None:
        """The first viewpoint, if it still exists."""
        return self._start if self._start in self.context.document.graph_arrays.index else None

    def _begin(self, id: str) -> None:
        self._start = id
        self.context.editing.select(GraphSelection(frozenset({id})))
        self.context.refresh()

    def _join(self, there: str, go_on: bool) -> None:
        start = self._existing_start
        assert start is not None  # checked by the callers
        if there == start:
            self.cancel()
            return
        edit_commands.add_edge(self.context.editing, start, there)
        self._start = there if go_on else None
        self.context.refresh()

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        start, now = self._existing_start, self._now
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
        found = None if there is None else self._path_evidence(start, there)
        ink = GHOST if found is None else _INKS[found.support_of_edge]
        line(painter, surface, foot, np.array(end), ink)
        away = lengths.length(float(np.linalg.norm(np.array(end) - foot)))
        label(painter, QPointF(now.point), f"connect, {away}" if there is not None else away)
        if found is not None:
            label(painter, now.point + QPointF(0, 24), short_ids(self.context.document.graph, found.sentence), ink)

    def _path_evidence(self, start: str, there: str) -> PathExplanation | None:
        """The evidence between the two viewpoints, computed once for each pair and graph."""
        document = self.context.document
        key = (document.graph, document.contents, start, there)
        if self._key is None or any(a is not b for a, b in zip(self._key, key, strict=True)):
            self._key, self._between = key, path_between(document, start, there)
        return self._between


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
        join = self._joined() if pointer.adds_to_selection else None
        frame, edge = self._snap_targets(pointer)
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
        frame, edge = self._snap_targets(pointer)
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
        elif pointer.adds_to_selection and self._joined() is not None:
            words = "add a viewpoint and connect it"
        else:
            words = "add a viewpoint"
        self._ghost = None if place is None else (pointer.surface, pointer.point, np.array(place), words)
        self._joins = pointer.adds_to_selection
        self.context.refresh()
        return True

    _joins = False

    def on_pointer_left(self) -> None:
        self._ghost = None

    def cancel(self) -> bool:
        self._ghost = None
        self.context.refresh()
        return False

    def _joined(self) -> str | None:
        chosen = self.context.editing.selection.viewpoints
        return next(iter(chosen)) if len(chosen) == 1 else None

    def _snap_targets(self, pointer: Pointer) -> tuple[int | None, tuple[str, str] | None]:
        if pointer.free:
            return None, None
        edge = pointer.edge
        if edge is not None and not pointer.adds_to_selection:
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
