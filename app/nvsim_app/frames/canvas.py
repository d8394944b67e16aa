"""The canvas that compares the photo of a frame with its render: wipe, blink, difference, or side by side.

Layers can be overlaid, and all panes share one zoom. Images of numbers have a legend and show the value under the
cursor."""

from __future__ import annotations

from typing import Any, Protocol

from PySide6.QtCore import QPointF, QRect, QRectF, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPen, QRegion, QWheelEvent
from PySide6.QtWidgets import QWidget

from nvsim_app.frames.correction import Box
from nvsim_app.frames.layers import FrameLayer
from nvsim_app.frames.panes import Pane, Zoom, panes
from nvsim_app.frames.pictures import PaintedImage, difference
from nvsim_app.look.plain_text import lines
from nvsim_app.painting.legend import legend_box, paint_legend, paint_values_at_cursor, words_box
from nvsim_app.painting.primitives import paint_label
from nvsim_app.painting.value_colors import ImageValues

MODES = ("photo", "render", "wipe", "blink", "difference", "beside")
BLINK = 600  # milliseconds
_GRIP = 9.0  # pixels to both sides of the divider


class Tool(Protocol):
    """A mouse tool that replaces moving the image. The event methods return whether they consumed the event."""

    def press(self, event: QMouseEvent, pane: Pane) -> bool: ...
    def move(self, event: QMouseEvent, pane: Pane) -> bool: ...
    def release(self, event: QMouseEvent, pane: Pane) -> bool: ...
    def wheel(self, event: QWheelEvent, pane: Pane) -> bool: ...
    def paint(self, painter: QPainter, pane: Pane, hovered: bool) -> None: ...


class Canvas(QWidget):
    """Paints the photo, the render, and the layers of a frame.

    zoomChanged()   the zoom or the position changed
    modeChanged()   another one of MODES is selected
    """

    zoomChanged = Signal()
    modeChanged = Signal()

    def __init__(self, layers: tuple[FrameLayer, ...], parent: QWidget | None = None) -> None:
        super().__init__(parent, focusPolicy=Qt.FocusPolicy.StrongFocus, mouseTracking=True)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setMinimumSize(240, 200)
        self._layers = layers
        self.tool: Tool | None = None
        self.mode = "wipe"
        self.note = ""  # shown if there is no image
        self.render_note = ""  # shown if there is no render
        self.names = {"photo": "Photo", "render": "Render"}
        self._size = (0, 0)
        self._photo: PaintedImage | None = None
        self._render: PaintedImage | None = None
        self._difference: PaintedImage | None = None
        self._gain = 3.0
        self.divider = 0.5  # share of the pane's width
        self._phase = False  # blink shows the render
        self._zoom = Zoom()
        self._dragged: QPointF | None = None
        self._wiping = False
        self._hover: QPointF | None = None
        self._blink = QTimer(self, interval=BLINK)
        self._blink.timeout.connect(self._on_blink)

    # Content ----------------------------------------------------------------------------------------------------

    def show_photo(self, photo: PaintedImage | None, keep_zoom: bool) -> None:
        """Shows the photo of another frame and removes the render. All panes use its size. None clears the canvas."""
        size = photo.size if photo is not None else (0, 0)
        if not keep_zoom or size != self._size:
            self._zoom = Zoom()
        self._photo, self._size = photo, size
        self._render = self._difference = None
        self.update()

    def show_render(self, render: PaintedImage | None) -> None:
        self._render, self._difference = render, None
        self.update()

    def set_mode(self, mode: str) -> None:
        """Selects the comparison: one of MODES."""
        if mode != self.mode:
            self.mode = mode
            self.modeChanged.emit()
        self._phase = False
        if mode == "blink" and self.isVisible():
            self._blink.start()
        else:
            self._blink.stop()
        self.update()

    def set_gain(self, gain: float) -> None:
        """Sets the factor by which the difference is amplified."""
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
        """The current panes; empty if there is no image."""
        if self._photo is None:
            return []
        return panes(QRectF(self.rect()), *self._size, self._zoom, self.mode == "beside")

    def pane_at(self, point: QPointF) -> Pane | None:
        found = self.panes()
        return next((pane for pane in found if pane.rect.contains(point)), found[0] if found else None)

    def refresh(self, box: Box) -> None:
        """Repaints these pixels of the image in every pane."""
        for pane in self.panes():
            a, b = pane.to_canvas(box.left, box.top), pane.to_canvas(box.right, box.bottom)
            self.update(QRectF(a, b).toAlignedRect().adjusted(-2, -2, 2, 2))

    def _on_blink(self) -> None:
        self._phase = not self._phase
        self.update()

    # Values -----------------------------------------------------------------------------------------------------

    def _content_of_pane(self, number: int) -> str:
        """The content of the pane with this number: "photo", "render", or the mode."""
        both = {"beside": ("photo", "render")[number], "blink": ("photo", "render")[self._phase]}
        return both.get(self.mode, self.mode)

    def _readings(self, what: str) -> list[tuple[str, ImageValues]]:
        """The name and the numbers of each image of numbers in a pane that shows `what`, the topmost first."""
        found: list[tuple[str, PaintedImage | None]] = []
        if what != "difference":
            found = [(layer.title, layer.painted) for layer in self._layers if layer.shown]
        if what in ("render", "wipe"):
            found.insert(0, (self.names["render"], self._render))
        elif what == "difference":
            found.insert(0, ("Difference", self._difference))
        return [(name, painted.reading) for name, painted in reversed(found) if painted and painted.reading]

    @property
    def legends(self) -> list[ImageValues]:
        """The distinct readings of all visible images of numbers."""
        shown = [r for number in range(len(self.panes())) for _, r in self._readings(self._content_of_pane(number))]
        return list({id(r): r for r in shown}.values())

    @property
    def values(self) -> list[tuple[str, ImageValues, Any]]:
        """Name, reading, and value of each image of numbers under the cursor; empty outside the image."""
        if self._hover is None or self._photo is None:
            return []
        for number, pane in enumerate(self.panes()):
            if pane.rect.contains(self._hover):
                what = self._content_of_pane(number)
                if what == "wipe" and self._hover.x() < pane.rect.left() + self.divider * pane.rect.width():
                    what = "photo"
                x, y = pane.to_image(self._hover)
                share = x / self._size[0], y / self._size[1]
                found = [(name, r, r.value_at(*share)) for name, r in self._readings(what)]
                return [row for row in found if row[2] is not None]
        return []

    @property
    def value_words(self) -> list[str]:
        """The values under the cursor as text. If there are several, each has its name."""
        found = self.values
        if len(found) == 1:
            return [found[0][1].scale.words(found[0][2])]
        return [f"{name}: {reading.scale.words(value)}" for name, reading, value in found]

    def _corners(self) -> list[tuple[ImageValues, QPointF]]:
        """The lower left corners of the legends, which are stacked at the lower left of the canvas."""
        at, placed = QPointF(8.0, self.height() - 8.0), []
        for reading in self.legends:
            placed.append((reading, QPointF(at)))
            at.setY(legend_box(reading.scale, at).top() - 4)
        return placed

    def _hover_at(self, point: QPointF | None) -> None:
        """Moves the value display to the cursor; repaints only the values and legends."""
        before, self._hover = self._hover_box(), point
        region = QRegion(before.united(self._hover_box()).toAlignedRect().adjusted(-2, -2, 2, 2))
        for reading, corner in self._corners():
            region += legend_box(reading.scale, corner).toAlignedRect().adjusted(-2, -2, 2, 2)
        self.update(region)

    def _hover_box(self) -> QRectF:
        words = self.value_words if self._says_values else []
        return words_box(self.font(), words, self._hover, QRectF(self.rect())) if words and self._hover else QRectF()

    @property
    def _says_values(self) -> bool:
        """Whether values are shown beside the cursor: only if the mouse is not used for something else."""
        return self.tool is None and self._dragged is None and not self._wiping

    def _paint_values(self, painter: QPainter) -> None:
        under = {id(reading): value for _, reading, value in self.values}
        for reading, corner in self._corners():
            paint_legend(painter, reading.scale, corner, under.get(id(reading)))
        words = self.value_words if self._says_values else []
        if words and self._hover is not None:
            paint_values_at_cursor(painter, words, self._hover, QRectF(self.rect()))

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
        self._paint_values(painter)
        painter.end()

    def _paint_pane(self, painter: QPainter, pane: Pane, number: int) -> None:
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform, pane.scale < 3)
        what = self._content_of_pane(number)
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
        # Colors of a difference are numbers, which the tint of a layer would falsify.
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
            _label(painter, QPointF(pane.rect.left() + 10, pane.rect.top() + 30), self.names["photo"])
            width = painter.fontMetrics().horizontalAdvance(self.names["render"]) + 22
            _label(painter, QPointF(pane.rect.right() - width, pane.rect.top() + 30), self.names["render"])
        else:
            name = self.names.get(what, what.capitalize())
            _label(painter, QPointF(pane.rect.left() + 10, pane.rect.top() + 30), name)

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
        image = painted.scaled_down(round(target.width() * ratio), round(target.height() * ratio))
        painter.drawImage(target, image)

    def _paint_divider(self, painter: QPainter, pane: Pane, edge: float) -> None:
        top, bottom = pane.rect.top(), pane.rect.bottom()
        painter.setPen(QPen(QColor(0, 0, 0, 120), 4))
        painter.drawLine(QPointF(edge, top), QPointF(edge, bottom))
        painter.setPen(QPen(QColor("#ffffff"), 2))
        painter.drawLine(QPointF(edge, top), QPointF(edge, bottom))
        painter.setBrush(QColor("#ffffff"))
        painter.setPen(QPen(QColor(0, 0, 0, 120), 1))
        grip = self._handle_center(pane)
        painter.drawEllipse(grip, 11, 11)
        painter.setPen(QPen(QColor("#444b55"), 1.8))
        for way in (-1, 1):
            painter.drawPolyline(
                [grip + QPointF(way * 3, -3.5), grip + QPointF(way * 6.5, 0), grip + QPointF(way * 3, 3.5)]
            )

    def _handle_center(self, pane: Pane) -> QPointF:
        """The center of the round handle. It is near the bottom, so that it does not cover the compared content."""
        return QPointF(pane.rect.left() + self.divider * pane.rect.width(), pane.rect.bottom() - 34)

    # Events -----------------------------------------------------------------------------------------------------

    def _on_divider(self, point: QPointF, pane: Pane) -> bool:
        """Whether `point` grabs the divider. With a tool, only the handle does, so that users can paint across the
        divider."""
        if self.mode != "wipe":
            return False
        away = point - self._handle_center(pane)
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
        self._hover_at(event.position())
        pane = self.pane_at(event.position())
        if pane is None:
            return
        if self._wiping:
            share = (event.position().x() - pane.rect.left()) / max(1.0, pane.rect.width())
            self.divider = min(max(share, 0.0), 1.0)
            self.update()
        elif self._dragged is not None:
            self.set_zoom(pane.zoom_after_drag(event.position() - self._dragged))
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
    return paint_label(painter, anchor, text, QColor("#dfe7ee"), QColor(16, 20, 26, 170)).toRect()
