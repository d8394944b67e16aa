"""The panorama of a viewpoint with its regions of interest. Drag turns it, the wheel zooms. Alpha and normals have a
legend and show the value under the cursor."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QImage, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF, QResizeEvent, QWheelEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from nvsim_app.inspector.panoramas import Panoramas
from nvsim_app.inspector.state import Inspection, NeighborMarks, densify_outline, direction_hit, viewing_angles
from nvsim_app.look import colors
from nvsim_app.look.plain_text import lines, tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.painting.legend import legend_box, paint_legend
from nvsim_app.painting.primitives import paint_label
from nvsim_app.painting.value_colors import OF_CHANNEL, alpha_shown, normal_shown
from nvsim_app.state.directions import Direction

_TURN = 2 * math.pi
_NEAREST = 6.0  # maximum zoom; 1 shows the whole turn
_CLICK = 4.0  # maximum movement of a click, pixels
_UNDER_COMPASS = 25.0  # height of the compass, pixels
_DOWN = -0.5  # initial elevation of the view center, radians: the regions are below the horizon
_NAMES = (("N", 0), ("NE", 45), ("E", 90), ("SE", 135), ("S", 180), ("SW", 225), ("W", 270), ("NW", 315))


class PanoramaView(QWidget):
    """Paints the panorama, its regions, and the marks of neighbors.

    chosen(Direction)   the user clicked a region
    walked(str)         the user clicked the mark of the neighbor with this viewpoint id
    """

    chosen = Signal(object)
    walked = Signal(str)

    def __init__(self, inspection: Inspection, panoramas: Panoramas, parent: QWidget | None = None) -> None:
        super().__init__(parent, mouseTracking=True, accessibleName="Panorama of the selected viewpoint")
        self.setObjectName("panoramaView")
        self.setMinimumSize(220, 80)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self._inspection, self._panoramas = inspection, panoramas
        self.neighbors = NeighborMarks(inspection)
        self.channel = "rgb"
        self.shows_regions = True
        self.hint = ""
        self._heading, self._elevation, self._zoom = 0.0, _DOWN, 1.0
        self._image: QImage | None = None
        self._shown: tuple[object, str] = (None, "")
        self._pressed: QPointF | None = None
        self._dragged = False
        self._hover: QPointF | None = None
        inspection.changed.connect(self.update)
        inspection.pointed.connect(self.update)
        panoramas.arrived.connect(self.update)

    def sizeHint(self) -> QSize:
        return QSize(380, self.minimumHeight())

    def set_channel(self, channel: str) -> None:
        """Shows one of panorama_child.PANORAMA_CHANNELS."""
        self.channel = channel
        self.update()

    def show_regions(self, on: bool) -> None:
        self.shows_regions = on
        self.update()

    def set_heading(self, heading: float) -> None:
        """Centers the view at `heading` (radians)."""
        self._heading = heading
        self.update()

    @property
    def view_center(self) -> tuple[float, float, float]:
        """Heading and elevation of the view center in radians, and the zoom; zoom 1 shows the whole turn."""
        return self._heading, self._elevation, self._zoom

    def set_view_center(self, heading: float, elevation: float, zoom: float) -> None:
        """Restores the view of `view_center`."""
        self._heading, self._elevation, self._zoom = heading, elevation, min(max(zoom, 1.0), _NEAREST)
        self.update()

    # Angles and pixels -----------------------------------------------------------------------------------------

    @property
    def _scale(self) -> float:
        """Pixels per radian. At zoom 1, the panorama covers at least the width and the height of the widget."""
        return max(self.width() / _TURN, self.height() / math.pi) * self._zoom

    def _middle(self) -> float:
        """Elevation of the view center, limited so that the view ends at the poles."""
        half = self.height() / 2 / self._scale
        return min(max(self._elevation, half - math.pi / 2), math.pi / 2 - half) if half < math.pi / 2 else 0.0

    def to_pixels(self, seen: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 2) pixels of headings and elevations (N, 2) in radians. Headings are not reduced to one turn."""
        x = self.width() / 2 + (seen[:, 0] - self._heading) * self._scale
        return np.stack([x, self.height() / 2 - (seen[:, 1] - self._middle()) * self._scale], axis=1)

    def to_angles(self, point: QPointF) -> tuple[float, float]:
        """Heading and elevation at a pixel, radians."""
        return (
            self._heading + (point.x() - self.width() / 2) / self._scale,
            self._middle() - (point.y() - self.height() / 2) / self._scale,
        )

    # Values ----------------------------------------------------------------------------------------------------

    @property
    def value(self) -> object:
        """The value of the pixel under the cursor: alpha as a number, a normal as (3,). None for colors, or if there
        is no surface or no cursor."""
        panorama = self._panoramas.current if self._inspection.viewpoint is not None else None
        if panorama is None or self._hover is None or not {"alpha", self.channel} <= panorama.pixels.keys():
            return None
        heading, elevation = self.to_angles(self._hover)
        row, column = (0.5 - elevation / math.pi), (heading / _TURN + 0.5) % 1.0
        height, width = panorama.pixels["alpha"].shape[:2]
        at = min(max(int(row * height), 0), height - 1), int(column * width) % width
        alpha = alpha_shown(panorama.pixels["alpha"][at])
        if self.channel == "normal":
            return normal_shown(panorama.pixels["normal"][at], alpha)
        return alpha if self.channel == "alpha" else None

    @property
    def value_words(self) -> str:
        """The value under the cursor as text, "" if there is none."""
        value = self.value
        return "" if value is None else OF_CHANNEL[self.channel].words(value)

    def _paint_value(self, painter: QPainter) -> None:
        scale = OF_CHANNEL.get(self.channel)
        if scale is None:
            return
        # At the top, over the ceiling, because the regions are at the bottom.
        high = legend_box(scale, QPointF()).height()
        box = paint_legend(painter, scale, QPointF(6, _UNDER_COMPASS + high), self.value)
        words = self.value_words
        if words:
            low = box.bottom() + painter.fontMetrics().height() + 7
            paint_label(painter, QPointF(6, low), words, QColor("#e8edf2"), QColor(16, 20, 26, 190))

    # Painting --------------------------------------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(self.rect(), QColor("#181a1f"))
        panorama = self._panoramas.current if self._inspection.viewpoint is not None else None
        if panorama is not None and self._shown != (panorama, self.channel):
            pixels = panorama.pixels.get(self.channel, panorama.pixels["rgb"])
            height, width = pixels.shape[:2]
            self._image = QImage(pixels.data, width, height, 4 * width, QImage.Format.Format_RGB32)
            self._shown = (panorama, self.channel)
        if panorama is not None and self._image is not None:
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            for box in self._boxes():
                painter.drawImage(box, self._image)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        self._paint_compass(painter)
        if self.shows_regions:
            self._paint_regions(painter)
        self.neighbors.paint(painter, self._middle(), self._scale, self.height(), self._heading, self.width())
        self._paint_words(painter, panorama is not None)
        if panorama is not None and self.channel in panorama.pixels:
            self._paint_value(painter)
        painter.end()

    def _boxes(self) -> list[QRectF]:
        """The rectangles of all visible copies of the image, whose left edge is south."""
        width, height = _TURN * self._scale, math.pi * self._scale
        ((left, top),) = self.to_pixels(np.array([[-math.pi, math.pi / 2]]))
        first = left - math.ceil(left / width) * width
        return [QRectF(first + k * width, top, width, height) for k in range(int(self.width() / width) + 2)]

    def _copies(self, points: NDArray[np.float64]) -> list[QPolygonF]:
        """All visible copies of the outline (N, 2) in pixels, shifted by whole turns."""
        width = _TURN * self._scale
        result = []
        first = math.ceil((-points[:, 0].max()) / width)
        for k in range(first, first + 3):
            moved = points[:, 0] + k * width
            if moved.max() >= 0 and moved.min() <= self.width():
                result.append(QPolygonF([QPointF(x, y) for x, y in zip(moved, points[:, 1], strict=True)]))
        return result

    def _outlines(self, corners: NDArray[np.float64], direction: Direction) -> list[QPolygonF]:
        seen = viewing_angles(densify_outline(corners), self._inspection.eye, direction.evidence.heading)
        return self._copies(self.to_pixels(seen))

    def _paint_regions(self, painter: QPainter) -> None:
        current = self._inspection.current
        # The highlighted region is drawn last, on top.
        for direction in sorted(self._inspection.directions, key=lambda d: (d is current, d.lattice)):
            pointed = direction is current
            ink = QColor(colors.OPEN if direction.open else colors.BLOCKED)
            fill = QColor(ink)
            fill.setAlpha(60 if pointed else 0)  # filled regions would cover the floor
            pen = QPen(QColor(colors.SELECTED) if pointed else ink, 2.4 if pointed else 1.6)
            if not direction.open:
                pen.setStyle(Qt.PenStyle.DotLine)
            elif not direction.lattice:
                pen.setStyle(Qt.PenStyle.DashLine)
            for outline in self._outlines(direction.polygon(), direction):
                painter.setPen(pen)
                painter.setBrush(fill)
                painter.drawPolygon(outline)
            failed = direction.failed_corners()
            if failed is not None and (direction.lattice or pointed):
                strong = QColor(colors.BLOCKED)
                strong.setAlpha(235 if pointed else 150)
                for outline in self._outlines(failed, direction):
                    painter.setPen(QPen(QColor("#ffffff") if pointed else strong, 1.2))
                    painter.setBrush(strong)
                    painter.drawPolygon(outline)

    def _paint_compass(self, painter: QPainter) -> None:
        painter.setFont(type_font("small"))
        step = 1 if _TURN * self._scale > 300 else 2
        for name, degrees in _NAMES[::step]:
            heading = math.radians(degrees)
            turned = (heading - self._heading + math.pi) % _TURN - math.pi + self._heading
            ((x, _),) = self.to_pixels(np.array([[turned, 0.0]]))
            width = painter.fontMetrics().horizontalAdvance(name) + 12
            paint_label(painter, QPointF(x - width / 2, 21), name, QColor("#e8edf2"), QColor(16, 20, 26, 150))

    def _paint_words(self, painter: QPainter, there: bool) -> None:
        if self._inspection.viewpoint is None:
            text = "Select a viewpoint to see its panorama."
        elif not there:
            text = self.hint or self._panoramas.failure_reason or self._panoramas.words
        elif self._panoramas.drawing:
            text = "rendering at full resolution…"
        else:
            return
        if there:
            paint_label(painter, QPointF(6, self.height() - 6), text, QColor("#e8edf2"), QColor(16, 20, 26, 170))
            return
        painter.setPen(QColor("#9aa5b1"))
        flags = Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop | Qt.TextFlag.TextWordWrap
        painter.drawText(self.rect().adjusted(20, 34, -20, -10), flags, lines(text))

    # Events ----------------------------------------------------------------------------------------------------

    def _direction_under(self, point: QPointF) -> Direction | None:
        if not self.shows_regions:
            return None
        return direction_hit(self._inspection.directions, self._inspection.eye, *self.to_angles(point))

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self._pressed, self._dragged = event.position(), False

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._hover = event.position()
        if self.channel in OF_CHANNEL:
            self.update()
        if self._pressed is None:
            near = self.neighbors.neighbor_under(event.position())
            if near != self.neighbors.hovered:
                self.neighbors.hovered = near
                self.update()
            if near is not None:
                self.setCursor(Qt.CursorShape.PointingHandCursor)
                self.setToolTip("Click to go to this viewpoint")
                return
            under = self._direction_under(event.position())
            self._inspection.point(under)
            self.setCursor(_cursor(under))
            self.setToolTip("" if under is None else tooltip_text(under.sentence))
            return
        step = event.position() - self._pressed
        if self._dragged or step.manhattanLength() > _CLICK:
            self._dragged = True
            self._heading = (self._heading - step.x() / self._scale) % _TURN
            self._elevation = self._middle() + step.y() / self._scale
            self._pressed = event.position()
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
            self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        clicked = self._pressed is not None and not self._dragged
        self._pressed = None
        near = self.neighbors.neighbor_under(event.position())
        if clicked and event.button() == Qt.MouseButton.LeftButton and near is not None:
            self.walked.emit(near)
            return
        under = self._direction_under(event.position())
        self.setCursor(_cursor(under))
        if clicked and event.button() == Qt.MouseButton.LeftButton and under is not None:
            self.chosen.emit(under)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if self._direction_under(event.position()) is None:
            self._zoom, self._elevation = 1.0, _DOWN
            self.update()

    def wheelEvent(self, event: QWheelEvent) -> None:
        before = self.to_angles(event.position())
        self._zoom = min(max(self._zoom * math.exp(event.angleDelta().y() / 600), 1.0), _NEAREST)
        after = self.to_angles(event.position())
        # Keep the point under the cursor fixed.
        self._heading = (self._heading + before[0] - after[0]) % _TURN
        self._elevation = self._middle() + before[1] - after[1]
        self.update()
        event.accept()

    def leaveEvent(self, event: QEvent) -> None:
        self._inspection.point(None)
        self._hover = None
        self.update()
        super().leaveEvent(event)

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.update()
        super().resizeEvent(event)


def _cursor(under: Direction | None) -> Qt.CursorShape:
    if under is None:
        return Qt.CursorShape.OpenHandCursor
    return Qt.CursorShape.PointingHandCursor if under.neighbor else Qt.CursorShape.ArrowCursor
