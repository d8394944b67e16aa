"""Paints thousands of lines and dots from numpy arrays in one painter call.

PySide6 accepts lists of QLineF, whose creation takes longer than the drawing. An internal class of pyqtgraph passes an
array instead; only this file uses that class.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pyqtgraph.Qt.internals import PrimitiveArray
from PySide6.QtCore import QLineF, QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPixmap, QPolygonF

from nvsim.figures import CORNERS
from nvsim_app.look.plain_text import plain

_LIMIT = 1e5  # pixels; Qt is slow with lines that extend far outside the image


class Primitives:
    """Paints lines and sprites. Buffers are reused between paintings."""

    def __init__(self) -> None:
        self._lines = PrimitiveArray(QLineF, 4)
        self._fragments = PrimitiveArray(QPainter.PixmapFragment, 10)

    def draw_lines(self, painter: QPainter, lines: NDArray[np.floating]) -> None:
        """Paints lines (N, 4) as x1 y1 x2 y2 in pixels with the pen of the painter."""
        if len(lines) == 0:
            return
        self._lines.resize(len(lines))
        np.clip(lines, -_LIMIT, _LIMIT, out=self._lines.ndarray())
        painter.drawLines(*self._lines.drawargs())

    def draw_sprites(
        self, painter: QPainter, centers: NDArray[np.floating], scales: NDArray[np.floating], sprite: QPixmap
    ) -> None:
        """Paints the sprite at `centers` (N, 2) in pixels, each scaled by `scales` (N, 2) in width and height."""
        if len(centers) == 0:
            return
        self._fragments.resize(len(centers))
        data = self._fragments.ndarray()
        # x, y, sourceLeft, sourceTop, width, height, scaleX, scaleY, rotation, opacity
        data[:, :2] = centers
        data[:, 2:4] = 0
        data[:, 4], data[:, 5] = sprite.width(), sprite.height()
        data[:, 6:8] = scales / sprite.devicePixelRatio()
        data[:, 8], data[:, 9] = 0, 1
        fragments, count = self._fragments.drawargs()
        painter.drawPixmapFragments(fragments, count, sprite)


def disc(color: str, outline: str, diameter: int = 24, shape: str = "disc") -> QPixmap:
    """A sprite with an outline: a shape of `figures.CORNERS`, "ring", or a disc. It has twice its size in pixels to be
    smooth."""
    sprite = QPixmap(2 * diameter, 2 * diameter)
    sprite.setDevicePixelRatio(2.0)
    sprite.fill(Qt.GlobalColor.transparent)
    painter = QPainter(sprite)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(QPen(QColor(outline), diameter / 10))
    painter.setBrush(QColor(color))
    margin = diameter / 10
    inner = diameter - 2 * margin
    if shape in CORNERS:
        painter.drawPolygon(QPolygonF([QPointF(margin + x * inner, margin + y * inner) for x, y in CORNERS[shape]]))
    elif shape == "ring":
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for pen in (QPen(QColor(outline), diameter / 4), QPen(QColor(color), diameter / 7)):
            painter.setPen(pen)
            painter.drawEllipse(QRectF(1.6 * margin, 1.6 * margin, inner - 1.2 * margin, inner - 1.2 * margin))
    else:
        painter.drawEllipse(QRectF(margin, margin, inner, inner))
    painter.end()
    return sprite


def chip_box(painter: QPainter, anchor: QPointF, text: str) -> QRectF:
    """The rectangle of `paint_label`."""
    metrics = painter.fontMetrics()
    width, height = metrics.horizontalAdvance(plain(text)) + 12, metrics.height() + 4
    return QRectF(anchor.x(), anchor.y() - height, width, height)


def paint_label(painter: QPainter, anchor: QPointF, text: str, text_color: QColor, fill: QColor) -> QRectF:
    """Paints a small rounded label with its lower left corner at `anchor`. Returns its rectangle."""
    text, box = plain(text), chip_box(painter, anchor, text)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(fill)
    painter.drawRoundedRect(box, 4, 4)
    painter.setPen(text_color)
    painter.drawText(box, Qt.AlignmentFlag.AlignCenter, text)
    return box
