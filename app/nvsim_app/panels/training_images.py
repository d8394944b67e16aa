"""Images of a training run: the latest previews of the models, and photo and model over the training steps."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QBuffer, QByteArray, QIODevice, QPointF, QRectF, QSignalBlocker, QSize, Qt, QTimer
from PySide6.QtGui import QColor, QImage, QImageReader, QPainter, QPaintEvent, QPixmap, QShowEvent
from PySide6.QtWidgets import QButtonGroup, QComboBox, QSlider, QToolButton, QWidget

from nvsim.events import Preview
from nvsim.files.opening import read_regular
from nvsim_app.frames.canvas import MODES, Canvas
from nvsim_app.frames.pictures import PaintedImage
from nvsim_app.jobs.history import image_key
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label, WrappingRow
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.theme import GRID, HALF, type_font
from nvsim_app.look.widgets import named
from nvsim_app.painting.primitives import chip_box, paint_label
from nvsim_app.painting.value_colors import ALPHA, ImageValues

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
                paint_label(
                    painter, corner + QPointF(0, box.height()), name, QColor("#e8edf2"), QColor(16, 20, 26, 190)
                )
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


_WORDS = {
    "photo": ("Photo", "Show only the photo"),
    "render": ("Model", "Show only the render of the model"),
    "wipe": ("Wipe", "Photo on the left of a line that can be dragged, model on the right"),
    "blink": ("Blink", "Alternate between photo and model"),
    "difference": ("Difference", "Difference between model and photo; bright means large"),
    "beside": ("Compare", "Photo and model side by side, at one zoom"),
}
_COMPARED = ("Model", "Alpha", "Background")
"""The parts of an image that can be compared with the photo."""
_SOON = 25  # milliseconds; while the slider is dragged, not every image is read


class TrainingImages(QWidget):
    """Shows the images of one submap of a job, compared with the photo or with another job."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self._other: JobHandle | None = None
        self._submap: int | None = None
        self._steps: list[int] = []
        self._listed: tuple[frozenset[int], ...] = ()
        self._files: dict[str, QImage] = {}  # path -> image, for the images on the canvas
        self._soon = QTimer(self, singleShot=True, interval=_SOON)
        self._soon.timeout.connect(self._show)
        self.canvas = Canvas((), self)
        self.canvas.setMinimumSize(200, 120)
        self.modes = QButtonGroup(self)
        buttons = [self._button(mode) for mode in MODES]
        self.part = self._choice(list(_COMPARED), "Image to compare with the photo")
        self.against = self._choice(["Photo", "Other run"], "Reference to compare the model with")
        above = WrappingRow(*buttons, self.part, self.against)
        above.setContentsMargins(4, 4, 4, 4)
        self.slider = named(QSlider(Qt.Orientation.Horizontal, self), "Step")
        self.slider.setToolTip(tooltip_text("Displayed training step; at the end, it follows the training"))
        self.slider.valueChanged.connect(lambda _: self._soon.start())
        self.words = Label(self)
        below = hbox((self.slider, 1), margins=(8, 4, 8, 4))
        vbox(above, (self.canvas, 1), below, self.words, on=self, margins=0, spacing=4)
        self.words.setContentsMargins(8, 0, 8, 4)
        self.words.setWordWrap(True)
        self._list()

    def sizeHint(self) -> QSize:
        return QSize(640, 480)

    def _button(self, mode: str) -> QToolButton:
        button = QToolButton(self)
        words, about = _WORDS[mode]
        button.setText(words)
        button.setToolTip(tooltip_text(about))
        button.setCheckable(True)
        button.setAutoRaise(True)
        button.setChecked(mode == self.canvas.mode)
        button.clicked.connect(partial(self.canvas.set_mode, mode))
        self.modes.addButton(button)
        return button

    def _choice(self, rows: list[str], about: str) -> QComboBox:
        box = named(QComboBox(self), tip=about)
        box.addItems(rows)
        box.currentIndexChanged.connect(lambda _: self._soon.start())
        return box

    # Contents ---------------------------------------------------------------------------------------------------

    def show_images(self, handle: JobHandle | None, other: JobHandle | None, submap: int | None) -> None:
        """Shows the images of `submap`; None selects the last submap that has images. `other` is a job to compare."""
        self._handle, self._other, self._submap = handle, other, submap
        self._list()

    def refresh(self) -> None:
        """Adds new steps."""
        if self._listed != self._reported_steps():
            self._list()

    @property
    def step(self) -> int | None:
        """The displayed step."""
        row = self.slider.value()
        return self._steps[row] if 0 <= row < len(self._steps) else None

    def _reported_images(self, handle: JobHandle | None) -> dict[int, Preview]:
        """Step -> image that the job reported, even if its file was deleted."""
        images = {} if handle is None else handle.history.images
        return images.get(next(reversed(images), "") if self._submap is None else image_key(self._submap), {})

    def _reported_steps(self) -> tuple[frozenset[int], ...]:
        """The steps that each of the two jobs reported."""
        return tuple(frozenset(self._reported_images(handle)) for handle in (self._handle, self._other))

    def _existing_images(self, handle: JobHandle | None) -> dict[int, Preview]:
        """Step -> image whose file still exists."""
        found = self._reported_images(handle)
        first = next(iter(found.values()), None)
        place = None if handle is None or first is None else handle.picture(first.path)
        if place is None:
            return {}
        try:
            names = set(os.listdir(place.parent))
        except OSError:
            return {}
        return {step: preview for step, preview in found.items() if Path(preview.path).name in names}

    def _list(self) -> None:
        """Lists the available steps. Keeps the displayed step, or follows the newest at the end of the slider."""
        shown, follows = self.step, self.slider.value() >= len(self._steps) - 1
        self._steps, self._listed = sorted(self._existing_images(self._handle)), self._reported_steps()
        with QSignalBlocker(self.slider):
            self.slider.setRange(0, max(0, len(self._steps) - 1))
            self.slider.setEnabled(len(self._steps) > 1)
            if self._steps:
                step = self._steps[-1] if follows or shown is None else _nearest(self._steps, shown)
                self.slider.setValue(self._steps.index(step))
        others = bool(self._existing_images(self._other))
        self.against.setVisible(others)
        if not others:
            self.against.setCurrentIndex(0)
        self._soon.start()

    def _show(self) -> None:
        step, canvas, handle = self.step, self.canvas, self._handle
        image = None if step is None or handle is None else self._reported_images(handle).get(step)
        if image is None or handle is None or step is None:
            self._files.clear()
            canvas.note = "Images of the training steps appear here while a submap trains."
            canvas.show_photo(None, keep_zoom=False)
            self.words.setText("")
            return
        name = _COMPARED[self.part.currentIndex()]
        row, column = PARTS[name]
        canvas.names = {"photo": "Photo", "render": name}
        used = {image.path}
        photo = self._quarter(handle, image.path, *PARTS["Photo"])
        others = self._existing_images(self._other)
        if self.against.currentIndex() == 1 and self._other is not None and others:
            near = _nearest(sorted(others), step)
            used.add(others[near].path)
            photo = self._quarter(self._other, others[near].path, row, column)
            canvas.names = {"photo": f"Other run, step {near:,}", "render": f"{name}, step {step:,}"}
        shown = self._quarter(handle, image.path, row, column)
        self._files = {path: file for path, file in self._files.items() if path in used}
        self.words.setText(image.caption)
        canvas.note = "The image of this step cannot be read."
        canvas.show_photo(photo, keep_zoom=True)
        canvas.show_render(shown)

    def _quarter(self, handle: JobHandle, path: str, row: int, column: int) -> PaintedImage | None:
        """One quarter of an image file; None if the file cannot be read."""
        if path not in self._files:
            place = handle.picture(path)
            self._files[path] = QImage() if place is None else read_picture(place)
        image = self._files[path]
        if image.isNull():
            return None
        pixels = _quarter(image, row, column)
        alpha = ImageValues(ALPHA, (pixels & 0xFF) / np.float32(255)) if (row, column) == PARTS["Alpha"] else None
        return PaintedImage(pixels, opaque=True, reading=alpha)


def _quarter(image: QImage, row: int, column: int) -> NDArray[np.uint32]:
    """(H, W) uint32 pixels of one quarter of an image."""
    whole = image.convertToFormat(QImage.Format.Format_RGB32)
    pixels = np.frombuffer(whole.constBits(), np.uint32).reshape(whole.height(), whole.bytesPerLine() // 4)
    height, width = whole.height() // 2, whole.width() // 2
    return pixels[row * height : (row + 1) * height, column * width : (column + 1) * width].copy()


def _nearest(steps: list[int], step: int) -> int:
    return min(steps, key=lambda s: abs(s - step))
