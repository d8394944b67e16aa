"""A drawing that is shown again and again while what it shows stays: a cursor that moves over ten thousand viewpoints
must not draw them all anew, and an edit of one of them draws only what stands around it."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from PySide6.QtCore import QObject, QRect, QRectF, QTimer
from PySide6.QtGui import QImage, QPainter

REST = 150  # milliseconds after which a view counts as one that stays
LARGEST_PATCH = 0.3  # of the image; beyond this it is drawn anew
Draw = Callable[[QPainter, QRectF | None], None]


class DrawingCache:
    """The first time a drawing is painted directly, since a view that moves never shows it again; the second time into
    an image, which is shown from then on.

    again   asks for another painting, which is done once the view rests, so that the image is there before it is needed
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
        """Paints what `draw` does, `width` x `height` logical pixels; it need not paint what lies outside the rectangle
        that it is given.

        view      is another when everything is drawn elsewhere or otherwise
        content   is another object when what is drawn changed; it is referenced, so that its id() is not used again
        touched   where it differs, in logical pixels, from what was drawn of the content given; None: everywhere
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
        """Draws a part of the image anew; False when that is not worth while."""
        # Whole device pixels, or the border would be smoothed.
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
