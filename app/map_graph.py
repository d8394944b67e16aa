"""The graph on the map: all edges and viewpoints in a few painter calls, in the pixels of the screen.

pyqtgraph's own curve and scatter items stroke a path and sort their points: for forty thousand edges and ten thousand
viewpoints twice as long as this takes.
"""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF
from PySide6.QtGui import QPainter
from PySide6.QtWidgets import QStyleOptionGraphicsItem, QWidget

from app.document import Document
from app.graph_arrays import GraphArrays
from app.graph_ink import LARGE, GraphInk
from app.kept_drawing import KeptDrawing

_RADIUS = 4.0  # pixels; smaller where viewpoints stand close together
_LEAST = 1.5
_MARGIN = 6  # pixels beside the widget whose discs still reach into it


class GraphItem(pg.GraphicsObject):
    """`hovered` is the id under the cursor of either view; `update` after setting it."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._ink = GraphInk()
        self._kept = KeptDrawing()
        self._bounds = QRectF()
        self._spacing = 1.0  # metres from a viewpoint to the next, about
        self.hovered: str | None = None
        self.setZValue(20)

    def refresh(self) -> None:
        """To be called when the document's graph is another."""
        positions = self._document.graph_arrays.positions
        bounds = QRectF()
        if len(positions):
            low, high = positions[:, :2].min(axis=0) - 1, positions[:, :2].max(axis=0) + 1
            bounds = QRectF(*low, *(high - low))
            area = float(np.prod(high - low))
            self._spacing = (area / len(positions)) ** 0.5
        if bounds != self._bounds:
            self.prepareGeometryChange()
            self._bounds = bounds
        self.update()

    def boundingRect(self) -> QRectF:
        return self._bounds

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        arrays = self._document.graph_arrays
        if not arrays.ids or widget is None:
            return
        origin, axes = self._transform(painter)
        pixels = arrays.positions[:, :2] @ axes + origin
        scale = float(np.linalg.norm(axes[0]))  # pixels per metre
        radius = float(np.clip(0.3 * self._spacing * scale, _LEAST, _RADIUS))
        width, height = widget.width(), widget.height()

        def draw(target: QPainter) -> None:
            self._draw(target, arrays, pixels, radius, (width, height))

        painter.save()
        painter.resetTransform()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if len(arrays.edges) > LARGE:
            self._kept.paint(painter, width, height, (arrays, *origin, *axes.ravel()), draw)
        else:
            draw(painter)
        selected = arrays.index.get(self._document.selection.viewpoint or "")
        hovered = arrays.index.get(self.hovered or "")
        for row in (hovered, selected):
            if row is not None:
                self._ink.draw_marked(painter, pixels[row], np.full(2, max(radius, 4.0)), row == selected)
        painter.restore()

    def _draw(
        self,
        painter: QPainter,
        arrays: GraphArrays,
        pixels: NDArray[np.float64],
        radius: float,
        size: tuple[int, int],
    ) -> None:
        a, b = pixels[arrays.edges[:, 0]], pixels[arrays.edges[:, 1]]
        seen = (np.maximum(a, b) >= 0).all(axis=1) & (np.minimum(a, b) <= size).all(axis=1)
        self._ink.draw_edges(painter, np.concatenate([a[seen], b[seen]], axis=1))
        margin = np.array(size) + _MARGIN
        rows = np.flatnonzero(((pixels > -_MARGIN) & (pixels < margin)).all(axis=1))
        self._ink.draw_viewpoints(painter, pixels[rows], np.full((len(rows), 2), radius), arrays.included[rows])

    def _transform(self, painter: QPainter) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(2,) the widget's logical pixel of world x, y = 0, and (2, 2) pixels of a metre along x and along y."""
        zero, right, up = (painter.transform().map(QPointF(x, y)) for x, y in ((0, 0), (1, 0), (0, 1)))
        origin = np.array([zero.x(), zero.y()])
        return origin, np.array([[right.x(), right.y()], [up.x(), up.y()]]) - origin
