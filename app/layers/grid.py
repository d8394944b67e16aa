"""A ground grid with a spacing of one meter, shown while there is no reconstruction."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtGui import QColor, QPainter, QPen

from app.layers.layer import Layer
from app.painting.drawing_cache import DrawingCache
from app.painting.picking import projected_segments
from app.painting.primitives import Primitives
from app.state.document import Document
from app.state.graph_arrays import extremes
from nvsim.geometry.camera import Camera

_SMOOTH = 120  # lines


class GridLayer(Layer):
    """The ground grid. The view sets `bare`, whether it shows no image of a reconstruction."""

    name = "grid"
    title = "Ground grid"

    def __init__(self, document: Document) -> None:
        self._document = document
        self._primitives = Primitives()
        self._kept = DrawingCache()
        self.bare = False

    @property
    def missing(self) -> str:
        return "" if self.bare else "shown only without a reconstruction"

    def paint(self, painter: QPainter, camera: Camera) -> None:
        extent = self._document.extent
        if not self.bare or len(extent) == 0:
            return
        low, high = extremes(extent)
        low, high = np.floor(low - 2), np.ceil(high + 2)
        height = round(float(np.median(extent[:, 2])), 1) - 1.5  # an edit of one viewpoint does not change it
        k = camera.intrinsics
        key = (camera, *low[:2].tolist(), *high[:2].tolist(), height)
        self._kept.paint(painter, k.width, k.height, key, lambda p, _: self._paint_all(p, camera, low, high, height))

    def _paint_all(
        self, painter: QPainter, camera: Camera, low: NDArray[np.float64], high: NDArray[np.float64], height: float
    ) -> None:
        step = max(1.0, np.ceil(float(max(high[:2] - low[:2])) / 200))  # large sites get a wider spacing
        x, y = np.arange(low[0], high[0] + 1, step), np.arange(low[1], high[1] + 1, step)
        a = np.concatenate([[(v, low[1], height) for v in x], [(low[0], v, height) for v in y]])
        b = np.concatenate([[(v, high[1], height) for v in x], [(high[0], v, height) for v in y]])
        lines, _, _ = projected_segments(camera, a, b)
        painter.setPen(QPen(QColor(150, 165, 180, 46), 1))
        # On a large site, antialiasing of the grid would take longer than painting all viewpoints.
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, len(lines) < _SMOOTH)
        self._primitives.draw_lines(painter, lines)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
