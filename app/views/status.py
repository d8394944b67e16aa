"""The status texts of the 3D view: camera position, renderer, and current work; and the background without an image."""

from __future__ import annotations

from PySide6.QtCore import QPoint, QPointF, QRect, QSize, Qt
from PySide6.QtGui import QColor, QLinearGradient, QPainter, QPalette

from app.drawing.render_child import WHOLE, Picture
from app.look import lengths
from app.look.metrics import type_font
from app.look.plain_text import plain
from app.painting.cameras import ViewPose, heading_degrees
from app.painting.primitives import chip


def paint_ground(painter: QPainter, size: QSize, palette: QPalette) -> None:
    """Paints the background that is shown if there is no image."""
    dark = palette.window().color().lightness() < 128
    gradient = QLinearGradient(0, 0, 0, size.height())
    gradient.setColorAt(0, QColor("#242a33" if dark else "#eef2f6"))
    gradient.setColorAt(1, QColor("#14171c" if dark else "#cfd8e1"))
    painter.fillRect(QRect(QPoint(0, 0), size), gradient)


def paint_status(painter: QPainter, size: QSize, pose: ViewPose, picture: Picture | None, words: str) -> None:
    """Paints the pose at the lower left, and `words` at the top center if there are any."""
    painter.setFont(type_font("small"))
    ink, fill = QColor("#dfe7ee"), QColor(16, 20, 26, 175)
    x, y, z = pose.position
    facts = [lengths.place(x, y, z, decimals=1), f"{heading_degrees(pose):.0f}°"]
    if picture is not None:
        k = picture.request.camera.intrinsics
        facts += ["whole building" if picture.submap == WHOLE else f"submap {picture.submap}", f"{k.width}×{k.height}"]
        facts += [f"{picture.renderer} {picture.milliseconds:.0f} ms"]
    chip(painter, QPointF(10, size.height() - 10), "   ".join(facts), ink, fill)
    if words:
        box = QRect(QPoint(0, 0), size).adjusted(16, 8, -16, -8)
        flags = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop | Qt.TextFlag.TextWordWrap
        needed = painter.boundingRect(box, flags, plain(words))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(fill)
        painter.drawRoundedRect(needed.adjusted(-6, -2, 6, 2), 4, 4)
        painter.setPen(ink)
        painter.drawText(needed, flags, plain(words))
