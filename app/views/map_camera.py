"""The 3D view's camera on the map."""

from __future__ import annotations

import math

import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPainterPath, QPen
from PySide6.QtWidgets import QGraphicsSceneMouseEvent, QStyleOptionGraphicsItem, QWidget

from app.look import colors
from app.painting.cameras import ViewPose


class CameraMarker(pg.GraphicsObject):
    """Marks the camera of the 3D view with a dot and a wedge for its direction, at a constant size in pixels. Dragging
    the dot moves the camera.

    dragged(float x, float y): the new position in meters, world.
    """

    dragged = Signal(float, float)

    def __init__(self) -> None:
        super().__init__()
        self.setFlag(self.GraphicsItemFlag.ItemIgnoresTransformations)
        self.setZValue(50)
        self.setCursor(Qt.CursorShape.SizeAllCursor)
        self.setToolTip("The camera of the 3D view; drag it to move")
        self._wedge = math.radians(70)
        self._heading = 0.0

    def show_pose(self, pose: ViewPose) -> None:
        x, y, _ = pose.position
        self.setPos(x, y)
        self._heading = pose.heading
        self.update()

    def boundingRect(self) -> QRectF:
        return QRectF(-34, -34, 68, 68)

    def shape(self) -> QPainterPath:
        path = QPainterPath()
        path.addEllipse(QPointF(0, 0), 9, 9)
        return path

    def paint(self, painter: QPainter, option: QStyleOptionGraphicsItem, widget: QWidget | None = None) -> None:
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        # On the screen y points down, so heading 0 (north) is up and headings turn clockwise.
        painter.rotate(math.degrees(self._heading))
        fill = QColor(colors.CAMERA)
        fill.setAlpha(70)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(fill)
        degrees = math.degrees(self._wedge)
        painter.drawPie(QRectF(-32, -32, 64, 64), round(16 * (90 - degrees / 2)), round(16 * degrees))
        painter.setPen(QPen(QColor("#ffffff"), 1.5))
        painter.setBrush(QColor(colors.CAMERA))
        painter.drawEllipse(QPointF(0, 0), 5.5, 5.5)

    def mousePressEvent(self, event: QGraphicsSceneMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            event.accept()
        else:
            event.ignore()

    def mouseMoveEvent(self, event: QGraphicsSceneMouseEvent) -> None:
        place = self.mapToParent(event.pos())
        self.dragged.emit(place.x(), place.y())
