"""The latest preview images of the models in training."""

from __future__ import annotations

import os
from pathlib import Path

from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QImage, QImageReader, QPainter, QPaintEvent, QPixmap, QShowEvent
from PySide6.QtWidgets import QWidget

from app.jobs.queue import JobHandle
from app.look.metrics import GRID, HALF, type_font
from app.look.plain_text import plain
from app.painting.primitives import chip, chip_box
from nvsim.events import Preview
from nvsim.files.opening import read_regular

PARTS = {"Photo": (0, 0), "Model": (0, 1), "Alpha": (1, 0), "Background": (1, 1)}
"""The quarters of a preview image of a training: name -> row and column."""
MOST = 3  # images side by side; the newest ones
_GAP = 8
_MOST_BYTES = 32 << 20
_MOST_SIDE = 8192  # pixels


class JobPreview(QWidget):
    """Shows the latest images of a job. Reads an image only if it is new and the panel is visible."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self._shown: dict[str, tuple[Preview, int, QPixmap]] = {}  # subject -> preview, time of its file, image
        self.setMinimumHeight(60)

    def show_job(self, handle: JobHandle | None) -> None:
        """Shows the images of this job; None shows nothing."""
        self._handle = handle
        self._shown.clear()
        self.refresh()

    def refresh(self) -> None:
        """Reads new images."""
        if not self.isVisible() or self._handle is None:
            self.update()
            return
        images = dict(list(self._handle.history.images.items())[-MOST:])
        self._shown = {name: self._shown[name] for name in images if name in self._shown}
        for name, steps in images.items():
            newest = steps[max(steps)]
            place = self._handle.picture(newest.path)
            if place is None:
                continue
            try:
                stamp = os.lstat(place).st_mtime_ns
            except OSError:
                continue
            known = self._shown.get(name)
            if known is None or (known[0], known[1]) != (newest, stamp):
                image = read_picture(place)
                if not image.isNull():
                    self._shown.pop(name, None)
                    self._shown[name] = newest, stamp, QPixmap.fromImage(image)
                    self.update()
                break  # decode one image per call

    @property
    def pictures(self) -> list[QPixmap]:
        """The displayed images, oldest first."""
        return [pixmap for _, _, pixmap in self._shown.values()]

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.refresh()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        if not self._shown:
            painter.setPen(self.palette().placeholderText().color())
            words = "An image appears here while a submap trains."
            painter.drawText(self.rect().adjusted(12, 8, -12, -8), Qt.AlignmentFlag.AlignTop, words)
            return
        caption = painter.fontMetrics().height() + 4
        width = (self.width() - _GAP * (len(self._shown) - 1)) / len(self._shown)
        for i, (preview, _, pixmap) in enumerate(self._shown.values()):
            size = pixmap.size().scaled(int(width), max(1, self.height() - caption), Qt.AspectRatioMode.KeepAspectRatio)
            left = round(i * (width + _GAP))
            painter.drawPixmap(left, 0, size.width(), size.height(), pixmap)
            self._paint_names(painter, QRectF(left, 0, size.width(), size.height()))
            painter.setPen(self.palette().text().color())
            words = plain(preview.caption)
            fitted = painter.fontMetrics().elidedText(words, Qt.TextElideMode.ElideRight, int(width))
            painter.drawText(left, size.height() + caption - 5, fitted)

    def _paint_names(self, painter: QPainter, image: QRectF) -> None:
        """Names the quarters of an image, if they are large enough."""
        painter.save()
        painter.setFont(type_font("small"))
        for name, (row, column) in PARTS.items():
            corner = QPointF(image.x() + column * image.width() / 2 + HALF, row * image.height() / 2 + HALF)
            box = chip_box(painter, corner, name)
            if box.width() + GRID <= image.width() / 2 and box.height() + GRID <= image.height() / 2:
                chip(painter, corner + QPointF(0, box.height()), name, QColor("#e8edf2"), QColor(16, 20, 26, 190))
        painter.restore()


def read_picture(path: Path) -> QImage:
    """Reads a JPEG image. Returns a null image if there is none, or if it exceeds 32 MiB or 8192 pixels a side."""
    try:
        data = QBuffer()
        data.setData(QByteArray(read_regular(path, _MOST_BYTES)))
    except OSError:
        return QImage()
    data.open(QIODevice.OpenModeFlag.ReadOnly)
    reader = QImageReader(data, b"jpeg")  # the format that the training writes; no other decoder is needed
    size: QSize = reader.size()
    if not size.isValid() or max(size.width(), size.height()) > _MOST_SIDE:
        return QImage()
    return reader.read()
