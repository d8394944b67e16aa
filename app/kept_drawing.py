"""A drawing that is shown again and again while what it shows stays: a cursor that moves over ten thousand viewpoints
must not draw them all anew."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from PySide6.QtGui import QImage, QPainter


class KeptDrawing:
    """The first time a drawing is painted directly, since a view that moves never shows it again; the second time into
    an image, which is shown from then on."""

    def __init__(self) -> None:
        self._key: Hashable = None
        self._image: QImage | None = None

    def paint(
        self, painter: QPainter, width: int, height: int, key: Hashable, draw: Callable[[QPainter], None]
    ) -> None:
        """Paints what `draw` does, `width` x `height` logical pixels. `key` is another when the drawing would be;
        whatever it holds is kept alive, so that identities do not come again."""
        ratio = painter.device().devicePixelRatioF()
        key = (key, width, height, ratio)
        if key != self._key:
            self._key, self._image = key, None
            draw(painter)
            return
        if self._image is None:
            self._image = QImage(round(width * ratio), round(height * ratio), QImage.Format.Format_ARGB32_Premultiplied)
            self._image.setDevicePixelRatio(ratio)
            self._image.fill(0)
            own = QPainter(self._image)
            own.setRenderHint(QPainter.RenderHint.Antialiasing)
            draw(own)
            own.end()
        painter.drawImage(0, 0, self._image)
