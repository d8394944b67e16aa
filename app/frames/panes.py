"""Where an image lies on the canvas: one zoom for all panes, so that the same place is seen in each. Of Qt it uses only
its rectangles."""

from __future__ import annotations

from dataclasses import dataclass, replace

from PySide6.QtCore import QPointF, QRectF

FARTHEST, NEAREST = 0.05, 40.0  # logical pixels per image pixel
_GAP = 2.0


@dataclass(frozen=True)
class Zoom:
    """scale  logical pixels per image pixel, 0 fits the image into its pane
    x, y   image pixel in the middle of a pane
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
        """Where the whole image lies, on the canvas."""
        x, y = (self.zoom.x, self.zoom.y) if self.zoom.scale else (self.width / 2, self.height / 2)
        middle = self.rect.center()
        return QRectF(
            middle.x() - x * self.scale, middle.y() - y * self.scale, self.width * self.scale, self.height * self.scale
        )

    def to_image(self, point: QPointF) -> tuple[float, float]:
        """Image pixels (x, y) under a point of the canvas, also beside the image."""
        corner = self.image_rect.topLeft()
        return (point.x() - corner.x()) / self.scale, (point.y() - corner.y()) / self.scale

    def to_canvas(self, x: float, y: float) -> QPointF:
        corner = self.image_rect.topLeft()
        return QPointF(corner.x() + x * self.scale, corner.y() + y * self.scale)

    def zoomed(self, factor: float, at: QPointF) -> Zoom:
        """`factor` times as large; what is under `at` stays there. Smaller than what fits it does not become."""
        scale = min(max(self.scale * factor, FARTHEST), NEAREST)
        if scale <= self.fitting * 1.001 and factor < 1:
            return Zoom()
        x, y = self.to_image(at)
        middle = self.rect.center()
        return Zoom(scale, x - (at.x() - middle.x()) / scale, y - (at.y() - middle.y()) / scale)

    def dragged(self, by: QPointF) -> Zoom:
        """Moved by so many pixels of the canvas; the image's middle stays within the pane."""
        if not self.zoom.scale:
            return self.zoom
        x = min(max(self.zoom.x - by.x() / self.scale, 0.0), float(self.width))
        y = min(max(self.zoom.y - by.y() / self.scale, 0.0), float(self.height))
        return replace(self.zoom, x=x, y=y)


def panes(size: QRectF, width: int, height: int, zoom: Zoom, beside: bool) -> list[Pane]:
    """One pane, or two: beside each other, or above each other where images of `width` x `height` become larger so."""
    if not beside:
        return [Pane(size, width, height, zoom)]
    x, y, half_width, half_height = size.left(), size.top(), (size.width() - _GAP) / 2, (size.height() - _GAP) / 2
    left = Pane(QRectF(x, y, half_width, size.height()), width, height, zoom)
    above = Pane(QRectF(x, y, size.width(), half_height), width, height, zoom)
    if above.fitting > left.fitting:
        return [above, replace(above, rect=above.rect.translated(0, half_height + _GAP))]
    return [left, replace(left, rect=left.rect.translated(half_width + _GAP, 0))]
