"""The latest images of the models in training, as the job writes them."""

from __future__ import annotations

import os
from pathlib import Path

from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QSize, Qt
from PySide6.QtGui import QImageReader, QPainter, QPaintEvent, QPixmap, QShowEvent
from PySide6.QtWidgets import QWidget

from app.jobs.queue import JobHandle
from app.look.plain_text import plain
from nvsim.files.nofollow import read_regular

MOST = 3  # images side by side; those that came last
_GAP = 8
_MOST_BYTES = 32 << 20
_MOST_SIDE = 8192  # pixels


class JobPreview(QWidget):
    """Reads an image when it is new and the panel can be seen."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self._pixmaps: dict[str, tuple[int, QPixmap]] = {}  # path -> time of the file, image
        self.setMinimumHeight(60)

    def show_job(self, handle: JobHandle | None) -> None:
        """Shows that job's images from now on; None shows nothing."""
        self._handle = handle
        self._pixmaps.clear()
        self.refresh()

    def refresh(self) -> None:
        """Looks for new images."""
        if not self.isVisible() or self._handle is None:
            self.update()
            return
        previews = list(self._handle.history.previews)[-MOST:]
        for path in previews:
            place = self._handle.picture(path)
            if place is None:
                continue
            try:
                stamp = os.lstat(place).st_mtime_ns
            except OSError:
                continue
            if self._pixmaps.get(path, (0,))[0] != stamp:
                pixmap = _picture(place)
                if not pixmap.isNull():
                    self._pixmaps[path] = (stamp, pixmap)
                    self.update()
                break  # one image a turn is decoded

    @property
    def pictures(self) -> list[QPixmap]:
        """What is shown, oldest first."""
        return [pixmap for _, pixmap in list(self._pixmaps.values())[-MOST:]]

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.refresh()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        pictures = self.pictures
        if not pictures or self._handle is None:
            painter.setPen(self.palette().placeholderText().color())
            words = "An image appears here while a submap trains."
            painter.drawText(self.rect().adjusted(12, 8, -12, -8), Qt.AlignmentFlag.AlignTop, words)
            return
        caption = painter.fontMetrics().height() + 4
        width = (self.width() - _GAP * (len(pictures) - 1)) / len(pictures)
        previews = self._handle.history.previews
        for i, (path, (_, pixmap)) in enumerate(list(self._pixmaps.items())[-MOST:]):
            size = pixmap.size().scaled(int(width), max(1, self.height() - caption), Qt.AspectRatioMode.KeepAspectRatio)
            left = round(i * (width + _GAP))
            painter.drawPixmap(left, 0, size.width(), size.height(), pixmap)
            painter.setPen(self.palette().text().color())
            words = plain(previews[path].caption) if path in previews else ""
            fitted = painter.fontMetrics().elidedText(words, Qt.TextElideMode.ElideRight, int(width))
            painter.drawText(left, size.height() + caption - 5, fitted)


def _picture(path: Path) -> QPixmap:
    """A null one where there is no image, or one larger than any that a job writes."""
    try:
        data = QBuffer()
        data.setData(QByteArray(read_regular(path, _MOST_BYTES)))
    except OSError:
        return QPixmap()
    data.open(QIODevice.OpenModeFlag.ReadOnly)
    reader = QImageReader(data, b"jpeg")  # as the training writes it, and no other decoder
    size: QSize = reader.size()
    if not size.isValid() or max(size.width(), size.height()) > _MOST_SIDE:
        return QPixmap()
    return QPixmap.fromImage(reader.read())
