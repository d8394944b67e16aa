"""Drawing functions of the modes: lines, dots, areas, and small labels over a view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPolygonF

from app.look import colors
from app.look.plain_text import SENTENCE, plain
from app.painting.picking import NEAR
from app.views.graph_surface import GraphSurface

GHOST = colors.SELECTED
_LABEL = QColor(16, 20, 26, 225)
_WRAPPED = Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter | Qt.TextFlag.TextWordWrap
_WIDEST = 280.0  # pixels; a longer label has several lines


def label(painter: QPainter, anchor: QPointF, text: str, ink: str = "#f2f5f8") -> None:
    """Draws a small label beside `anchor` (pixels), inside the view. A long text wraps."""
    text = plain(text, SENTENCE)
    box = label_box(painter, anchor, text)
    painter.setPen(Qt.PenStyle.NoPen)
    painter.setBrush(_LABEL)
    painter.drawRoundedRect(box, 4, 4)
    painter.setPen(QColor(ink))
    painter.drawText(box.adjusted(6, 2, -6, -2), _WRAPPED, text)


def label_box(painter: QPainter, anchor: QPointF, text: str) -> QRectF:
    """The rectangle of `label` in pixels."""
    picture = painter.viewport()
    room = QRectF(0, 0, min(_WIDEST, max(40.0, picture.width() - 20.0)), 10_000)
    words = painter.boundingRect(room, _WRAPPED, text)
    width, height = words.width() + 13, words.height() + 4
    x = min(max(anchor.x() + 12, 4.0), max(4.0, picture.width() - width - 4))
    y = anchor.y() - 14 - painter.fontMetrics().height()  # several lines grow downward, away from a label above
    return QRectF(x, max(4.0, min(y, picture.height() - 4 - height)), width, height)


def line(
    painter: QPainter,
    surface: GraphSurface,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    color: str = GHOST,
    width: float = 2.2,
    style: Qt.PenStyle = Qt.PenStyle.DashLine,
) -> None:
    """Draws lines between world positions `a` and `b` in meters, each (N, 3) or (3,)."""
    lines, _, _ = surface.segments(np.atleast_2d(a), np.atleast_2d(b))
    pen = QPen(QColor(color), width, style)
    pen.setCapStyle(Qt.PenCapStyle.RoundCap)
    painter.setPen(pen)
    for x1, y1, x2, y2 in lines:
        painter.drawLine(QPointF(x1, y1), QPointF(x2, y2))


def dots(
    painter: QPainter,
    surface: GraphSurface,
    places: NDArray[np.float64],
    color: str = GHOST,
    radius: float = 6.0,
    filled: bool = True,
) -> None:
    """Draws discs, or rings if not `filled`, at world positions (N, 3) or (3,) in meters. `radius` is in pixels."""
    if not len(places):
        return
    pixels, depths = surface.project(np.atleast_2d(places))
    painter.setPen(QPen(QColor("#1d1502" if filled else color), 1.4 if filled else 2.4))
    painter.setBrush(QColor(color) if filled else Qt.BrushStyle.NoBrush)
    for (x, y), depth in zip(pixels, depths, strict=True):
        if depth > NEAR:
            painter.drawEllipse(QPointF(x, y), radius, radius)


def area(painter: QPainter, shape: QRectF | QPolygonF) -> None:
    """Draws a selection area, a rectangle or polygon in pixels."""
    fill = QColor(colors.SELECTED)
    fill.setAlpha(38)
    painter.setPen(QPen(QColor(colors.SELECTED), 1.4, Qt.PenStyle.DashLine))
    painter.setBrush(fill)
    if isinstance(shape, QRectF):
        painter.drawRect(shape)
    else:
        painter.drawPolygon(shape)
