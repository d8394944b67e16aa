"""The mode that selects Gaussians of a splat with a box or a lasso, to remove or to keep them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QKeyEvent, QPainter, QPolygonF

from nvsim_app.modes.mode import Mode, ModeContext, Pointer, area
from nvsim_app.processes.background import BackgroundWork
from nvsim_app.state.cleaning import FARTHEST, SplatCleaning, rows_in_outline
from nvsim_app.views.graph_surface import GraphSurface, SceneSurface

_APART = 3.0  # pixels between the points of a lasso
_CONTROL = Qt.KeyboardModifier.ControlModifier
_SHIFT = Qt.KeyboardModifier.ShiftModifier


class CleanMode(Mode):
    """Selects Gaussians in the 3D view. `begin` and `end` are called when the mode is entered and left.

    cleaning  None until the candidates are found
    lasso     whether a drag draws a lasso, not a box
    reach     greatest depth of selected Gaussians, meters
    """

    name = "clean"
    hint = (
        "Drag selects Gaussians, also behind others (Shift adds, Ctrl toggles) · B box, K lasso · Del removes, "
        "Shift+Del keeps · Ctrl+Z undoes · right drag turns the camera · Esc leaves without changes"
    )
    cursor = Qt.CursorShape.CrossCursor
    needs_graph = False

    def __init__(self, context: ModeContext, begin: Callable[[], None], end: Callable[[], None]) -> None:
        super().__init__(context)
        self._begin, self._end = begin, end
        self.cleaning: SplatCleaning | None = None
        self.lasso, self.reach = False, FARTHEST
        self.on_shape: Callable[[], object] = lambda: None
        """Called when a key changed `lasso`."""
        self._search = BackgroundWork("outline", context.document)
        self._surface: GraphSurface | None = None
        self._way: tuple[QPointF, ...] = ()

    def enter(self) -> None:
        self._begin()

    def leave(self) -> None:
        self.cancel()
        self.stop()
        self.cleaning = None
        self._end()

    def stop(self) -> None:
        """Returns after the search for the Gaussians in the last outline has ended."""
        self._search.stop()

    def cancel(self) -> bool:
        was, self._surface, self._way = self._surface is not None, None, ()
        self.context.refresh()
        return was

    # Mouse -----------------------------------------------------------------------------------------------------

    def click(self, pointer: Pointer) -> bool:
        """Clears the selection. No click selects a viewpoint."""
        if self.cleaning is not None and not (pointer.adds_to_selection or pointer.toggles_selection):
            self.cleaning.select(np.zeros(0, np.int64))
        return True

    def takes_drag(self, start: Pointer) -> bool:
        return self.cleaning is not None and isinstance(start.surface, SceneSurface)

    def drag(self, start: Pointer, now: Pointer) -> None:
        self._surface = start.surface
        if not self.lasso:
            (x, y), (a, b) = start.point.toTuple(), now.point.toTuple()
            self._way = tuple(QPointF(*corner) for corner in ((x, y), (a, y), (a, b), (x, b)))
        elif not self._way:
            self._way = (start.point, now.point)
        elif (now.point - self._way[-1]).manhattanLength() >= _APART:
            self._way = (*self._way, now.point)
        self.context.refresh()

    def end_drag(self, start: Pointer, now: Pointer) -> None:
        self.drag(start, now)
        outline, surface, cleaning = np.array([p.toTuple() for p in self._way]), start.surface, self.cleaning
        self.cancel()
        if cleaning is None or not isinstance(surface, SceneSurface):
            return
        camera, means, reach = surface.camera, cleaning.found.means, self.reach
        adds, toggles = now.adds_to_selection, now.toggles_selection
        self._search.start(
            lambda: rows_in_outline(camera, means, outline, reach),
            lambda rows: cleaning.select(rows, adds, toggles),
            self.context.say,
        )

    # Keys ------------------------------------------------------------------------------------------------------

    def takes_key(self, event: QKeyEvent) -> bool:
        return self._action(event) is not None

    def key(self, event: QKeyEvent) -> bool:
        action = self._action(event)
        if action is not None:
            action()
        return action is not None

    def _action(self, event: QKeyEvent) -> Callable[[], object] | None:
        key, cleaning = (event.modifiers(), Qt.Key(event.key())), self.cleaning
        none = Qt.KeyboardModifier.NoModifier
        shapes = {(none, Qt.Key.Key_B): False, (none, Qt.Key.Key_K): True}
        if key in shapes:
            return lambda: self.set_lasso(shapes[key])
        if cleaning is None:
            return None
        return {
            (none, Qt.Key.Key_Delete): cleaning.remove_selected,
            (_SHIFT, Qt.Key.Key_Delete): cleaning.keep_selected,
            (_CONTROL, Qt.Key.Key_Z): cleaning.undo,
            (_CONTROL | _SHIFT, Qt.Key.Key_Z): cleaning.redo,
        }.get(key)

    def set_lasso(self, on: bool) -> None:
        """Chooses whether a drag draws a lasso or a box."""
        self.lasso = on
        self.on_shape()

    def set_reach(self, meters: float) -> None:
        """Sets the greatest depth of selected Gaussians."""
        self.reach = meters

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        if self._surface is surface and len(self._way) > 1:
            area(painter, QPolygonF(list(self._way)))
