"""The geometry of images on the canvas: all panes share one zoom and show the same part of the image. Only the
rectangles use Qt."""

from __future__ import annotations

from dataclasses import dataclass, replace

from PySide6.QtCore import QPointF, QRectF

FARTHEST, NEAREST = 0.05, 40.0  # logical pixels per image pixel
_GAP = 2.0


@dataclass(frozen=True)
class Zoom:
    """The zoom of all panes.

    scale  logical pixels per image pixel, 0 fits the image into its pane
    x, y   image pixel at the center of a pane
    """

    scale: float = 0.0
    x: float = 0.0
    y: float = 0.0


@dataclass(frozen=True)
class Pane:
    """A rectangle of the canvas with an image of `width` x `height` pixels in it."""

    rect: QRectF
    width: int
    height: int
    zoom: Zoom

    @property
    def fitting(self) -> float:
        return max(1e-6, min(self.rect.width() / self.width, self.rect.height() / self.height))

    @property
    def scale(self) -> float:
        return self.zoom.scale or self.fitting

    @property
    def image_rect(self) -> QRectF:
        """The rectangle of the whole image on the canvas."""
        x, y = (self.zoom.x, self.zoom.y) if self.zoom.scale else (self.width / 2, self.height / 2)
        middle = self.rect.center()
        return QRectF(
            middle.x() - x * self.scale, middle.y() - y * self.scale, self.width * self.scale, self.height * self.scale
        )

    def to_image(self, point: QPointF) -> tuple[float, float]:
        """Image pixels (x, y) under a point of the canvas, also outside the image."""
        corner = self.image_rect.topLeft()
        return (point.x() - corner.x()) / self.scale, (point.y() - corner.y()) / self.scale

    def to_canvas(self, x: float, y: float) -> QPointF:
        corner = self.image_rect.topLeft()
        return QPointF(corner.x() + x * self.scale, corner.y() + y * self.scale)

    def zoomed(self, factor: float, at: QPointF) -> Zoom:
        """The zoom `factor` times as large around the fixed point `at`. If the image would become smaller than the
        pane, it fits the pane instead."""
        scale = min(max(self.scale * factor, FARTHEST), NEAREST)
        if scale <= self.fitting * 1.001 and factor < 1:
            return Zoom()
        x, y = self.to_image(at)
        middle = self.rect.center()
        return Zoom(scale, x - (at.x() - middle.x()) / scale, y - (at.y() - middle.y()) / scale)

    def zoom_after_drag(self, by: QPointF) -> Zoom:
        """The zoom moved by this number of canvas pixels. The center of the pane stays within the image."""
        if not self.zoom.scale:
            return self.zoom
        x = min(max(self.zoom.x - by.x() / self.scale, 0.0), float(self.width))
        y = min(max(self.zoom.y - by.y() / self.scale, 0.0), float(self.height))
        return replace(self.zoom, x=x, y=y)


def panes(size: QRectF, width: int, height: int, zoom: Zoom, beside: bool) -> list[Pane]:
    """One pane, or two panes for `beside`: side by side, or one above the other if images of `width` x `height` pixels
    are larger that way."""
    if not beside:
        return [Pane(size, width, height, zoom)]
    x, y, half_width, half_height = size.left(), size.top(), (size.width() - _GAP) / 2, (size.height() - _GAP) / 2
    left = Pane(QRectF(x, y, half_width, size.height()), width, height, zoom)
    above = Pane(QRectF(x, y, size.width(), half_height), width, height, zoom)
    if above.fitting > left.fitting:
        return [above, replace(above, rect=above.rect.translated(0, half_height + _GAP))]
    return [left, replace(left, rect=left.rect.translated(half_width + _GAP, 0))]
