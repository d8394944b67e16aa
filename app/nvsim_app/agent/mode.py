"""The agent mode of the graph views: keys, clicks on navigable locations, and drawing of the agent's pose."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QKeyEvent, QPainter, QPen, QPolygonF

from nvsim.geometry.directions import HEIGHT, VFOV, WIDTH
from nvsim_app.agent.agent_walk import AgentWalk
from nvsim_app.agent.state import AgentState
from nvsim_app.look import colors
from nvsim_app.modes.mode import Mode, ModeContext, Pointer, dots, line
from nvsim_app.painting.picking import NEAR
from nvsim_app.views.graph_surface import GraphSurface

_ACROSS = 2 * math.atan(math.tan(VFOV / 2) * WIDTH / HEIGHT)  # horizontal field of view, radians
_METERS, _PIXELS = 1.5, 44.0  # minimum length of the wedge of the field of view, in meters and in pixels
_MARK = 10.0  # radius of a location's mark, pixels
_TURNS = {
    Qt.Key.Key_Left: (-1, 0),
    Qt.Key.Key_Right: (1, 0),
    Qt.Key.Key_Up: (0, 1),
    Qt.Key.Key_Down: (0, -1),
}
_DIGITS = {Qt.Key(Qt.Key.Key_0 + digit): digit for digit in range(10)}
_BARE = Qt.KeyboardModifier.NoModifier | Qt.KeyboardModifier.KeypadModifier


class AgentMode(Mode):
    """Controls the agent with keys and clicks, and draws its trajectory, pose, and navigable locations."""

    name = "agent"
    hint = "← → turn by 30° · ↑ ↓ look up and down · 1–9 or click: move · Backspace: undo · Home: start · Esc: stop"

    def __init__(
        self,
        context: ModeContext,
        walk: AgentWalk,
        begin: Callable[[], None],
        end: Callable[[], None],
        copy: Callable[[], None],
    ) -> None:
        """`begin` and `end` are called when the mode is entered and left; `copy` copies the state."""
        super().__init__(context)
        self._walk, self._begin, self._end, self._copy = walk, begin, end, copy

    def enter(self) -> None:
        self._begin()

    def leave(self) -> None:
        self._end()

    # Keys -----------------------------------------------------------------------------------------------------------

    def takes_key(self, event: QKeyEvent) -> bool:
        return self._action(event) is not None

    def key(self, event: QKeyEvent) -> bool:
        action = self._action(event)
        if action is None:
            return False
        action()
        return True

    def _action(self, event: QKeyEvent) -> Callable[[], None] | None:
        key, walk = Qt.Key(event.key()), self._walk
        if event.modifiers() == Qt.KeyboardModifier.ControlModifier and key == Qt.Key.Key_C:
            return self._copy
        if event.modifiers() & ~_BARE:
            return None
        if key in _TURNS:
            right, up = _TURNS[key]
            return lambda: walk.turn(right, up)
        if key in _DIGITS:
            return lambda: walk.move_to_location(_DIGITS[key])
        return {Qt.Key.Key_Backspace: walk.undo_action, Qt.Key.Key_Home: walk.home}.get(key)

    # Mouse ----------------------------------------------------------------------------------------------------------

    def click(self, pointer: Pointer) -> bool:
        """Moves to the clicked viewpoint if it is navigable. All clicks are consumed, so that nothing is selected."""
        id = pointer.viewpoint
        state = self._walk.state
        if id is not None and state is not None and id != state.location.viewpointId:
            self._walk.take_viewpoint(id)
        return True

    def hover(self, pointer: Pointer) -> bool:
        id = pointer.viewpoint
        there = id is not None and self._walk.index_of(id) > 0
        pointer.surface.widget.setCursor(Qt.CursorShape.PointingHandCursor if there else Qt.CursorShape.ArrowCursor)
        return False

    # Drawing --------------------------------------------------------------------------------------------------------

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        state = self._walk.state
        if state is None:
            return
        self._paint_trail(painter, surface)
        self._paint_agent(painter, surface, state)
        self._paint_locations(painter, surface, state)

    def _floor_points(self, ids: list[str]) -> NDArray[np.float64]:
        """(N, 3) floor points of the viewpoints that are in the graph, meters, world."""
        arrays = self.context.document.graph_arrays
        return arrays.feet[arrays.viewpoint_rows(ids)]

    def _paint_trail(self, painter: QPainter, surface: GraphSurface) -> None:
        way = [pose.viewpoint for pose in self._walk.trajectory]
        feet = self._floor_points([id for before, id in zip(["", *way], way) if id != before])
        if len(feet) > 1:
            line(painter, surface, feet[:-1], feet[1:], colors.AGENT, 4.0, Qt.PenStyle.SolidLine)
            dots(painter, surface, feet, colors.AGENT, 4.5)

    def _paint_agent(self, painter: QPainter, surface: GraphSurface, state: AgentState) -> None:
        feet = self._floor_points([state.location.viewpointId])
        if not len(feet):
            return
        foot = feet[0]
        ahead = np.array([math.sin(state.heading), math.cos(state.heading), 0.0])
        pixels, depths = surface.project(np.stack([foot, foot + 0.1 * ahead]))
        if depths[0] <= NEAR:
            return
        scale = 10 * float(np.linalg.norm(pixels[1] - pixels[0]))  # pixels per meter at the agent
        reach = max(_METERS, min(_PIXELS / max(scale, 1e-3), 50.0))
        turns = state.heading + np.linspace(-_ACROSS / 2, _ACROSS / 2, 17)
        rim = foot + reach * np.stack([np.sin(turns), np.cos(turns), np.zeros(17)], axis=1)
        fill = QColor(colors.AGENT)
        fill.setAlpha(70)
        self._polygon(painter, surface, np.concatenate([foot[None], rim]), fill, QColor(colors.AGENT))
        side = np.array([ahead[1], -ahead[0], 0.0])
        arrow = np.array([[0.42, 0.0], [-0.24, 0.22], [-0.12, 0.0], [-0.24, -0.22]]) * reach
        shape = foot + arrow[:, :1] * ahead + arrow[:, 1:] * side
        self._polygon(painter, surface, shape, QColor(colors.AGENT), QColor("#ffffff"))

    def _polygon(
        self, painter: QPainter, surface: GraphSurface, places: NDArray[np.float64], fill: QColor, rim: QColor
    ) -> None:
        pixels, depths = surface.project(places)
        if (depths <= NEAR).any():
            return  # a part is behind the camera
        painter.setPen(QPen(rim, 1.4))
        painter.setBrush(fill)
        painter.drawPolygon(QPolygonF([QPointF(x, y) for x, y in pixels]))

    def _paint_locations(self, painter: QPainter, surface: GraphSurface, state: AgentState) -> None:
        places = state.navigableLocations[1:]
        arrays = self.context.document.graph_arrays
        numbered = [(i, arrays.index[p.viewpointId]) for i, p in enumerate(places, 1) if p.viewpointId in arrays.index]
        if not numbered:
            return
        pixels, depths = surface.project(arrays.feet[[row for _, row in numbered]])
        for (index, _), (x, y), depth in zip(numbered, pixels, depths, strict=True):
            if depth <= NEAR:
                continue
            painter.setPen(QPen(QColor("#ffffff"), 1.6))
            painter.setBrush(QColor(colors.AGENT))
            painter.drawEllipse(QPointF(x, y), _MARK, _MARK)
            box = QRectF(x - 20, y - 20, 40, 40)
            painter.drawText(box, Qt.AlignmentFlag.AlignCenter, str(index))
