"""The mouse tools that correct a mask: a brush, and points from which surfaces grow."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QPointF, QRect, QRectF, Qt
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPen, QWheelEvent

from nvsim_app.frames.correction import Box, Correction, Point, Prompt
from nvsim_app.frames.layers import FLOOR_COLOR
from nvsim_app.frames.panes import Pane

NOT_FLOOR = "#ff6b6b"
SMALLEST, LARGEST = 0.7, 400.0  # limits of the brush radius, image pixels
_SHIFT = Qt.KeyboardModifier.ShiftModifier
_CONTROL = Qt.KeyboardModifier.ControlModifier


class Brush:
    """The brush. The left button paints floor, the right button erases it. Shift draws a straight line from the end of
    the last stroke. The wheel changes the size; with Ctrl it zooms.

    painted(Box)  called after every segment of a stroke
    ended()       called after a stroke that changed the mask
    sized(float)  called after the radius changed
    moved(QRect)  called with the area to repaint after the cursor moved
    """

    def __init__(
        self,
        painted: Callable[[Box], object],
        ended: Callable[[], object],
        sized: Callable[[float], object],
        moved: Callable[[QRect], object],
    ) -> None:
        self.correction: Correction | None = None
        self.radius = 18.0
        self._drawn = QRect()
        self._painted, self._ended, self._sized, self._moved = painted, ended, sized, moved
        self._last: Point | None = None  # last point of the current stroke
        self._anchor: Point | None = None  # start of a straight line
        self._floor = True
        self._cursor: QPointF | None = None
        self._straight = False

    def set_correction(self, correction: Correction | None) -> None:
        """Sets the correction of another frame; None disables the tool."""
        self.correction, self._anchor, self._last = correction, None, None

    def grow(self, factor: float) -> None:
        self.radius = min(max(self.radius * factor, SMALLEST), LARGEST)
        self._sized(self.radius)

    def press(self, event: QMouseEvent, pane: Pane) -> bool:
        if self.correction is None or event.button() not in (Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton):
            return False
        here = pane.to_image(event.position())
        self._floor = event.button() == Qt.MouseButton.LeftButton
        self.correction.begin()
        straight = bool(event.modifiers() & _SHIFT) and self._anchor is not None
        self._last = self._anchor if straight and self._anchor is not None else here
        self._step(here)
        return True

    def move(self, event: QMouseEvent, pane: Pane) -> bool:
        self._cursor = event.position()
        self._straight = bool(event.modifiers() & _SHIFT)
        if self._last is not None:
            self._step(pane.to_image(event.position()))
        self._repaint_cursor(pane)
        return True

    def _repaint_cursor(self, pane: Pane) -> None:
        """Repaints the old and the new area of the cursor."""
        assert self._cursor is not None
        reach = self.radius * pane.scale + 3
        around = QRectF(self._cursor.x() - reach, self._cursor.y() - reach, 2 * reach, 2 * reach)
        if self._straight and self._anchor is not None and self._last is None:
            around = around.united(QRectF(self._cursor, pane.to_canvas(*self._anchor)).normalized())
        drawn = around.toAlignedRect().adjusted(-2, -2, 2, 2)
        self._moved(self._drawn.united(drawn))
        self._drawn = drawn

    def release(self, event: QMouseEvent, pane: Pane) -> bool:
        if self.correction is None or self._last is None:
            return False
        self._anchor, self._last = self._last, None
        if self.correction.end("Paint floor" if self._floor else "Erase floor"):
            self._ended()
        return True

    def wheel(self, event: QWheelEvent, pane: Pane) -> bool:
        if event.modifiers() & _CONTROL:
            return False
        self.grow(1.0012 ** (event.angleDelta().y() or event.angleDelta().x()))
        return True

    def paint(self, painter: QPainter, pane: Pane, hovered: bool) -> None:
        if self._cursor is None or not hovered:
            return
        radius = self.radius * pane.scale
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for color, width in ((QColor(0, 0, 0, 160), 3.0), (QColor("#ffffff"), 1.4)):
            painter.setPen(QPen(color, width))
            painter.drawEllipse(self._cursor, radius, radius)
        if self._straight and self._anchor is not None and self._last is None:
            painter.setPen(QPen(QColor("#ffffff"), 1.4, Qt.PenStyle.DashLine))
            painter.drawLine(pane.to_canvas(*self._anchor), self._cursor)

    def _step(self, here: Point) -> None:
        assert self.correction is not None and self._last is not None
        box = self.correction.paint(self._last, here, self.radius, self._floor)
        self._last = here
        if box is not None:
            self._painted(box)


class Points:
    """Sets points: the left button marks a surface as floor, the right button as not floor.

    placed(Prompt)  called with each point
    """

    def __init__(self, placed: Callable[[Prompt], object]) -> None:
        self.correction: Correction | None = None
        self._placed = placed

    def set_correction(self, correction: Correction | None) -> None:
        """Sets the correction of another frame; None disables the tool."""
        self.correction = correction

    def press(self, event: QMouseEvent, pane: Pane) -> bool:
        if self.correction is None or event.button() not in (Qt.MouseButton.LeftButton, Qt.MouseButton.RightButton):
            return False
        x, y = pane.to_image(event.position())
        if 0 <= x < pane.width and 0 <= y < pane.height:
            self._placed(Prompt(x / pane.width, y / pane.height, event.button() == Qt.MouseButton.LeftButton))
        return True

    def move(self, event: QMouseEvent, pane: Pane) -> bool:
        return False

    def release(self, event: QMouseEvent, pane: Pane) -> bool:
        return True

    def wheel(self, event: QWheelEvent, pane: Pane) -> bool:
        return False

    def paint(self, painter: QPainter, pane: Pane, hovered: bool) -> None:
        for prompt in () if self.correction is None else self.correction.prompts:
            middle = pane.to_canvas(prompt.x * pane.width, prompt.y * pane.height)
            painter.setPen(QPen(QColor("#ffffff"), 2))
            painter.setBrush(QColor(FLOOR_COLOR if prompt.floor else NOT_FLOOR))
            painter.drawEllipse(middle, 8, 8)
            painter.drawLine(middle + QPointF(-4, 0), middle + QPointF(4, 0))
            if prompt.floor:
                painter.drawLine(middle + QPointF(0, -4), middle + QPointF(0, 4))
