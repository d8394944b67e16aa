"""Caches a drawing that is shown repeatedly. Moving the cursor over ten thousand viewpoints does not repaint them, and
an edit of one viewpoint repaints only its surroundings."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from PySide6.QtCore import QObject, QRect, QRectF, QTimer
from PySide6.QtGui import QImage, QPainter

REST = 150  # milliseconds after which a view counts as resting
LARGEST_PATCH = 0.3  # maximum share of the image that is repainted partially; beyond it, everything is repainted
Draw = Callable[[QPainter, QRectF | None], None]


class DrawingCache:
    """Caches a drawing as an image.

    The first time, a drawing is painted directly, because a moving view does not need it again. The second time, it is
    painted into an image, which is used for later paintings.

    again   requests another painting; called when the view rests, so that the image exists before it is needed
    """

    def __init__(self, parent: QObject | None = None, again: Callable[[], object] | None = None) -> None:
        self._view: Hashable = None
        self._content: object = None
        self._image: QImage | None = None
        self._rest = QTimer(parent, singleShot=True, interval=REST) if again is not None else None
        if self._rest is not None and again is not None:
            self._rest.timeout.connect(again)

    def paint(
        self,
        painter: QPainter,
        width: int,
        height: int,
        view: Hashable,
        draw: Draw,
        content: object = None,
        touched: Callable[[object], QRectF | None] | None = None,
    ) -> None:
        """Paints a drawing of `width` x `height` logical pixels, from the cache if possible.

        draw      paints the drawing; if it gets a rectangle, it may skip everything outside
        view      differs if the position or the style of the drawing changed
        content   another object if the content of the drawing changed; it is referenced, so that its id() stays unique
        touched   maps the previous content to the changed rectangle in logical pixels; None means everywhere
        """
        ratio = painter.device().devicePixelRatioF()
        view = (view, width, height, ratio)
        if view != self._view:
            self._view, self._content, self._image = view, content, None
            draw(painter, None)
            if self._rest is not None:
                self._rest.start()
            return
        if self._image is not None and content is not self._content:
            where = None if touched is None else touched(self._content)
            if where is None or not self._patch(self._image, where, ratio, draw):
                self._image = None
        if self._image is None:
            self._image = QImage(round(width * ratio), round(height * ratio), QImage.Format.Format_ARGB32_Premultiplied)
            self._image.setDevicePixelRatio(ratio)
            self._image.fill(0)
            own = QPainter(self._image)
            own.setRenderHint(QPainter.RenderHint.Antialiasing)
            draw(own, None)
            own.end()
        self._content = content
        painter.drawImage(0, 0, self._image)

    def _patch(self, image: QImage, where: QRectF, ratio: float, draw: Draw) -> bool:
        """Repaints a part of the image. Returns False if the part is too large."""
        # Whole device pixels, because antialiasing would affect the border otherwise.
        pixels = QRectF(ratio * where.x(), ratio * where.y(), ratio * where.width(), ratio * where.height())
        box: QRect = pixels.toAlignedRect() & image.rect()
        if box.width() * box.height() > LARGEST_PATCH * image.width() * image.height():
            return False
        if box.isEmpty():
            return True
        part = QRectF(box.x() / ratio, box.y() / ratio, box.width() / ratio, box.height() / ratio)
        own = QPainter(image)
        own.setClipRect(part)
        own.setCompositionMode(QPainter.CompositionMode.CompositionMode_Clear)
        own.fillRect(part, 0)
        own.setCompositionMode(QPainter.CompositionMode.CompositionMode_SourceOver)
        own.setRenderHint(QPainter.RenderHint.Antialiasing)
        draw(own, part)
        own.end()
        return True
