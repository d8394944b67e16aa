"""The photo of a frame and the render from its camera on one canvas: wipe, blink, difference, side by side; layers over
both; one zoom for all."""

from __future__ import annotations

from typing import Protocol

from PySide6.QtCore import QPointF, QRect, QRectF, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPen, QWheelEvent
from PySide6.QtWidgets import QWidget

from app.frames.brush import Box
from app.frames.layers import FrameLayer
from app.frames.panes import Pane, Zoom, panes
from app.frames.pictures import Painted, difference
from app.look.plain_text import lines
from app.painting.primitives import chip

MODES = ("photo", "render", "wipe", "blink", "difference", "beside")
BLINK = 600  # milliseconds
_GRIP = 9.0  # pixels to both sides of the divider


class Tool(Protocol):
    """What the mouse does instead of moving the image. Each answers whether it took the event."""

    def press(self, event: QMouseEvent, pane: Pane) -> bool: ...
    def move(self, event: QMouseEvent, pane: Pane) -> bool: ...
    def release(self, event: QMouseEvent, pane: Pane) -> bool: ...
    def wheel(self, event: QWheelEvent, pane: Pane) -> bool: ...
    def paint(self, painter: QPainter, pane: Pane, hovered: bool) -> None: ...


class Canvas(QWidget):
    """zoomChanged() after the user zoomed or moved."""

    zoomChanged = Signal()

    def __init__(self, layers: tuple[FrameLayer, ...], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setMinimumSize(240, 200)
        self._layers = layers
        self.tool: Tool | None = None
        self.mode = "wipe"
        self.note = ""  # what stands in place of the image
        self.render_note = ""  # what stands in place of the render
        self._size = (0, 0)
        self._photo: Painted | None = None
        self._render: Painted | None = None
        self._difference: Painted | None = None
        self._gain = 3.0
        self.divider = 0.5  # share of the pane's width
        self._phase = False  # blink shows the render
        self._zoom = Zoom()
        self._dragged: QPointF | None = None
        self._wiping = False
        self._hover: QPointF | None = None
        self._blink = QTimer(self, interval=BLINK)
        self._blink.timeout.connect(self._on_blink)

    # What is shown ----------------------------------------------------------------------------------------------

    def show_photo(self, photo: Painted | None, keep_zoom: bool) -> None:
        """Another frame; its size is that of all the panes. None clears the canvas."""
        size = photo.size if photo is not None else (0, 0)
        if not keep_zoom or size != self._size:
            self._zoom = Zoom()
        self._photo, self._size = photo, size
        self._render = self._difference = None
        self.update()

    def show_render(self, render: Painted | None) -> None:
        self._render, self._difference = render, None
        self.update()

    def set_mode(self, mode: str) -> None:
        """One of MODES."""
        self.mode = mode
        self._phase = False
        if mode == "blink" and self.isVisible():
            self._blink.start()
        else:
            self._blink.stop()
        self.update()

    def set_gain(self, gain: float) -> None:
        """Of the difference."""
        self._gain, self._difference = gain, None
        self.update()

    @property
    def zoom(self) -> Zoom:
        return self._zoom

    def set_zoom(self, zoom: Zoom) -> None:
        self._zoom = zoom
        self.zoomChanged.emit()
        self.update()

    def panes(self) -> list[Pane]:
        """Where the image lies now; none while there is no image."""
        if self._photo is None:
            return []
        return panes(QRectF(self.rect()), *self._size, self._zoom, self.mode == "beside")

    def pane_at(self, point: QPointF) -> Pane | None:
        found = self.panes()
        return next((pane for pane in found if pane.rect.contains(point)), found[0] if found else None)

    def refresh(self, box: Box) -> None:
        """Paints these pixels of the image again, in every pane."""
        for pane in self.panes():
            a, b = pane.to_canvas(box.left, box.top), pane.to_canvas(box.right, box.bottom)
            self.update(QRectF(a, b).toAlignedRect().adjusted(-2, -2, 2, 2))

    def _on_blink(self) -> None:
        self._phase = not self._phase
        self.update()

    # Painting ---------------------------------------------------------------------------------------------------

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.fillRect(event.rect(), self.palette().color(self.palette().ColorRole.Mid))
        found = self.panes()
        if not found:
            painter.setPen(self.palette().color(self.palette().ColorRole.PlaceholderText))
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap, lines(self.note))
            painter.end()
            return
        for number, pane in enumerate(found):
            painter.save()
            painter.setClipRect(pane.rect.intersected(QRectF(event.rect())))
            self._paint_pane(painter, pane, number)
            painter.restore()
        painter.end()

    def _paint_pane(self, painter: QPainter, pane: Pane, number: int) -> None:
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, pane.scale < 3)
        what = {"beside": ("photo", "render")[number], "blink": ("photo", "render")[self._phase]}.get(
            self.mode, self.mode
        )
        edge = pane.rect.left() + self.divider * pane.rect.width()
        if what == "wipe":
            self._paint_picture(painter, pane, "photo")
            painter.save()
            right = QRectF(edge, pane.rect.top(), pane.rect.right() - edge, pane.rect.height())
            painter.setClipRect(right, Qt.ClipOperation.IntersectClip)
            self._paint_picture(painter, pane, "render")
            painter.restore()
        else:
            self._paint_picture(painter, pane, what)
        # In a difference colours mean how far: a tint over it would be taken for that.
        for layer in self._layers if what != "difference" else ():
            if layer.shown and layer.painted is not None:
                painter.setOpacity(layer.opacity)
                painter.drawImage(pane.image_rect, layer.painted.image)
        painter.setOpacity(1.0)
        if self.tool is not None:
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            hovered = self._hover is not None and pane.rect.contains(self._hover)
            self.tool.paint(painter, pane, hovered)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        if what == "wipe":
            self._paint_divider(painter, pane, edge)
            _label(painter, QPointF(pane.rect.left() + 10, pane.rect.top() + 30), "Photo")
            width = painter.fontMetrics().horizontalAdvance("Render") + 22
            _label(painter, QPointF(pane.rect.right() - width, pane.rect.top() + 30), "Render")
        else:
            _label(painter, QPointF(pane.rect.left() + 10, pane.rect.top() + 30), what.capitalize())

    def _paint_picture(self, painter: QPainter, pane: Pane, what: str) -> None:
        assert self._photo is not None
        painted = self._photo if what == "photo" else self._render
        if painted is None:
            rect = pane.image_rect.intersected(pane.rect)
            painter.fillRect(rect, self.palette().base())
            painter.setPen(self.palette().color(self.palette().ColorRole.PlaceholderText))
            clip = painter.clipBoundingRect()
            painter.drawText(
                rect.intersected(clip) if self.mode == "wipe" and clip.width() > 150 else rect,
                Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap,
                self.render_note,
            )
            return
        if what == "difference":
            if self._difference is None:
                self._difference = difference(self._photo, painted, self._gain)
            painted = self._difference
        ratio = self.devicePixelRatioF()
        target = pane.image_rect
        image = painted.shrunk(round(target.width() * ratio), round(target.height() * ratio))
        painter.drawImage(target, image)

    def _paint_divider(self, painter: QPainter, pane: Pane, edge: float) -> None:
        top, bottom = pane.rect.top(), pane.rect.bottom()
        painter.setPen(QPen(QColor(0, 0, 0, 120), 4))
        painter.drawLine(QPointF(edge, top), QPointF(edge, bottom))
        painter.setPen(QPen(QColor("#ffffff"), 2))
        painter.drawLine(QPointF(edge, top), QPointF(edge, bottom))
        painter.setBrush(QColor("#ffffff"))
        painter.setPen(QPen(QColor(0, 0, 0, 120), 1))
        grip = self._grip(pane)
        painter.drawEllipse(grip, 11, 11)
        painter.setPen(QPen(QColor("#444b55"), 1.8))
        for way in (-1, 1):
            painter.drawPolyline(
                [grip + QPointF(way * 3, -3.5), grip + QPointF(way * 6.5, 0), grip + QPointF(way * 3, 3.5)]
            )

    def _grip(self, pane: Pane) -> QPointF:
        """The round handle; low, so that it is not in the middle of what is compared."""
        return QPointF(pane.rect.left() + self.divider * pane.rect.width(), pane.rect.bottom() - 34)

    # Events -----------------------------------------------------------------------------------------------------

    def _on_divider(self, point: QPointF, pane: Pane) -> bool:
        """With a tool in hand only the handle moves the divider, so that one can paint across it."""
        if self.mode != "wipe":
            return False
        away = point - self._grip(pane)
        if self.tool is not None:
            return QPointF.dotProduct(away, away) < 14**2
        return abs(away.x()) < _GRIP

    def mousePressEvent(self, event: QMouseEvent) -> None:
        pane = self.pane_at(event.position())
        if pane is None:
            return
        left = event.button() == Qt.MouseButton.LeftButton
        if left and self._on_divider(event.position(), pane):
            self._wiping = True
        elif self.tool is not None and self.tool.press(event, pane):
            pass
        elif left or event.button() == Qt.MouseButton.MiddleButton:
            self._dragged = event.position()
            self.setCursor(Qt.CursorShape.ClosedHandCursor)

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        self._hover = event.position()
        pane = self.pane_at(event.position())
        if pane is None:
            return
        if self._wiping:
            share = (event.position().x() - pane.rect.left()) / max(1.0, pane.rect.width())
            self.divider = min(max(share, 0.0), 1.0)
            self.update()
        elif self._dragged is not None:
            self.set_zoom(pane.dragged(event.position() - self._dragged))
            self._dragged = event.position()
        elif self.tool is not None and self.tool.move(event, pane):
            pass
        else:
            on = self._on_divider(event.position(), pane)
            self.setCursor(Qt.CursorShape.SplitHCursor if on else Qt.CursorShape.ArrowCursor)

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        pane = self.pane_at(event.position())
        if self._wiping or self._dragged is not None:
            self._wiping, self._dragged = False, None
            self.unsetCursor()
        elif pane is not None and self.tool is not None:
            self.tool.release(event, pane)

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        if self.tool is None and event.button() == Qt.MouseButton.LeftButton:
            self.set_zoom(Zoom())
        else:
            self.mousePressEvent(event)

    def wheelEvent(self, event: QWheelEvent) -> None:
        pane = self.pane_at(event.position())
        if pane is None or (self.tool is not None and self.tool.wheel(event, pane)):
            return
        self.set_zoom(pane.zoomed(1.0015 ** event.angleDelta().y(), event.position()))

    def leaveEvent(self, event: object) -> None:
        self._hover = None
        self.update()

    def hideEvent(self, event: object) -> None:
        self._blink.stop()

    def showEvent(self, event: object) -> None:
        self.set_mode(self.mode)


def _label(painter: QPainter, anchor: QPointF, text: str) -> QRect:
    return chip(painter, anchor, text, QColor("#dfe7ee"), QColor(16, 20, 26, 170)).toRect()
