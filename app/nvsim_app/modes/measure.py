"""The mode that measures: click points in order; each segment and the total length are shown. Enter asks for the true
length, which sets the scale of the project."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QKeyEvent, QPainter

from nvsim_app.look import lengths
from nvsim_app.modes.mode import Mode, Pointer, dots, label, line
from nvsim_app.views.graph_surface import GraphSurface

_INK = "#ff9da7"


class MeasureMode(Mode):
    """Measures the length of a polyline between clicked points."""

    name = "measure"
    hint = (
        "Click points to measure between them · snaps to viewpoints and the visible point cloud, Alt: no snap · "
        "Backspace removes the last point · Enter sets the scale by a known length"
    )
    cursor = Qt.CursorShape.CrossCursor
    needs_graph = False
    on_confirm: Callable[[], object] | None = None
    """Called by Enter, to set the scale from the measured length."""
    _places: tuple[tuple[float, float, float], ...] = ()
    _now: Pointer | None = None

    @property
    def meters(self) -> float:
        """Length of the measured polyline in meters."""
        places = np.array(self._places).reshape(-1, 3)
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())

    def click(self, pointer: Pointer) -> bool:
        place = self._place(pointer)
        if place is None:
            self.context.editing.refuse("There is no floor under the mouse pointer.")
        else:
            self._places = (*self._places, place)
            self.context.say(lengths.length(self.meters))
        self.context.refresh()
        return True

    def hover(self, pointer: Pointer) -> bool:
        pointer.surface.widget.setCursor(self.cursor)
        self._now = pointer
        self.context.refresh()
        return True

    def key(self, event: QKeyEvent) -> bool:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.on_confirm is not None:
            self.on_confirm()
            return True
        if event.key() != Qt.Key.Key_Backspace or not self._places:
            return False
        self._places = self._places[:-1]
        self.context.refresh()
        return True

    def on_pointer_left(self) -> None:
        self._now = None

    def cancel(self) -> bool:
        was, self._places, self._now = bool(self._places), (), None
        self.context.refresh()
        return was

    def _place(self, pointer: Pointer) -> tuple[float, float, float] | None:
        there = None if pointer.free else pointer.viewpoint
        if there is None:
            point = None if pointer.free else pointer.surface.pick_point(pointer.point)
            return pointer.surface.floor_point(pointer.point) if point is None else point
        arrays = self.context.document.graph_arrays
        x, y, z = (float(v) for v in arrays.feet[arrays.index[there]])
        return x, y, z

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        places = list(self._places)
        if places and self._now is not None and self._now.surface is surface:
            end = self._place(self._now)
            places += [end] if end is not None else []
        if not places:
            if self._now is not None and self._now.surface is surface:
                label(painter, self._now.point, "measure from here")
            return
        way = np.array(places)
        line(painter, surface, way[:-1], way[1:], _INK, style=Qt.PenStyle.SolidLine)
        dots(painter, surface, way, _INK, 4.5)
        parts = np.linalg.norm(np.diff(way, axis=0), axis=1)
        pixels, depths = surface.project(way)
        for i, meters in enumerate(parts):
            if depths[i] > 0 and depths[i + 1] > 0:
                total = f"   total {lengths.length(float(parts[: i + 1].sum()))}" if i and i == len(parts) - 1 else ""
                middle = (pixels[i] + pixels[i + 1]) / 2
                label(painter, QPointF(*middle), f"{lengths.length(float(meters))}{total}", _INK)
