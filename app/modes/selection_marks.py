"""Marks of the selection in every view: rings around viewpoints, bright edges. All marks take two drawing calls."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPainter, QPen

from app.look import colors
from app.painting.picking import NEAR
from app.painting.primitives import Primitives, disc
from app.state.document import Document
from app.views.graph_surface import GraphSurface

_SMOOTH = 2000  # lines; more are drawn without antialiasing, which would be too slow


class SelectionMarks:
    """Draws the marks of the selection."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._disc = disc(colors.SELECTED, "#3a2c05", 16)

    def paint(self, painter: QPainter, surface: GraphSurface) -> None:
        chosen, arrays = self._document.editing.selection, self._document.shown_arrays
        if chosen.edges:
            ends = arrays.feet[arrays.edges[arrays.edge_rows(chosen.edges)]]
            lines, _, _ = surface.segments(ends[:, 0], ends[:, 1])
            painter.setRenderHint(QPainter.RenderHint.Antialiasing, len(lines) < _SMOOTH)
            pen = QPen(QColor(colors.SELECTED), 3.6)
            pen.setCapStyle(Qt.PenCapStyle.RoundCap)
            painter.setPen(pen)
            self._primitives.draw_lines(painter, lines)
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if chosen.viewpoints:
            pixels, depths = surface.project(arrays.feet[arrays.viewpoint_rows(chosen.viewpoints)])
            seen = depths > NEAR
            size = 0.75 if len(pixels) < 200 else 0.5
            self._primitives.draw_sprites(painter, pixels[seen], np.full((int(seen.sum()), 2), size), self._disc)
