"""The images of a training run: photo and model on one canvas, and a slider over the training steps."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QSignalBlocker, QSize, Qt, QTimer
from PySide6.QtGui import QImage
from PySide6.QtWidgets import QButtonGroup, QComboBox, QHBoxLayout, QSlider, QToolButton, QVBoxLayout, QWidget

from app.frames.canvas import MODES, Canvas
from app.frames.pictures import Painted
from app.jobs.history import image_key
from app.jobs.queue import JobHandle
from app.look.labels import Label
from app.look.plain_text import tip
from app.look.wrapping import WrappingRow
from app.painting.scales import ALPHA, Reading
from app.panels.job_preview import PARTS, read_picture
from nvsim.events import Preview

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
        above = WrappingRow()
        above.setContentsMargins(4, 4, 4, 4)
        for mode in MODES:
            above.addWidget(self._button(mode))
        self.part = self._choice(list(_COMPARED), "Image to compare with the photo")
        self.against = self._choice(["Photo", "Other run"], "Reference to compare the model with")
        above.addWidget(self.part)
        above.addWidget(self.against)
        self.slider = QSlider(Qt.Orientation.Horizontal, self)
        self.slider.setToolTip(tip("Displayed training step; at the end, it follows the training"))
        self.slider.setAccessibleName("Step")
        self.slider.valueChanged.connect(lambda _: self._soon.start())
        self.words = Label(self)
        below = QHBoxLayout()
        below.setContentsMargins(8, 4, 8, 4)
        below.addWidget(self.slider, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(4)
        column.addLayout(above)
        column.addWidget(self.canvas, 1)
        column.addLayout(below)
        column.addWidget(self.words)
        self.words.setContentsMargins(8, 0, 8, 4)
        self.words.setWordWrap(True)
        self._list()

    def sizeHint(self) -> QSize:
        return QSize(640, 480)

    def _button(self, mode: str) -> QToolButton:
        button = QToolButton(self)
        words, about = _WORDS[mode]
        button.setText(words)
        button.setToolTip(tip(about))
        button.setCheckable(True)
        button.setAutoRaise(True)
        button.setChecked(mode == self.canvas.mode)
        button.clicked.connect(partial(self.canvas.set_mode, mode))
        self.modes.addButton(button)
        return button

    def _choice(self, rows: list[str], about: str) -> QComboBox:
        box = QComboBox(self)
        box.addItems(rows)
        box.setToolTip(tip(about))
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

    def show_step(self, step: int) -> None:
        """Shows the available step nearest to `step`."""
        if self._steps:
            self.slider.setValue(self._steps.index(_nearest(self._steps, step)))

    def _found(self, handle: JobHandle | None) -> dict[int, Preview]:
        """Step -> image that the job reported, even if its file was deleted."""
        images = {} if handle is None else handle.history.images
        return images.get(next(reversed(images), "") if self._submap is None else image_key(self._submap), {})

    def _reported_steps(self) -> tuple[frozenset[int], ...]:
        """The steps that each of the two jobs reported."""
        return tuple(frozenset(self._found(handle)) for handle in (self._handle, self._other))

    def _there(self, handle: JobHandle | None) -> dict[int, Preview]:
        """Step -> image whose file still exists."""
        found = self._found(handle)
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
        self._steps, self._listed = sorted(self._there(self._handle)), self._reported_steps()
        with QSignalBlocker(self.slider):
            self.slider.setRange(0, max(0, len(self._steps) - 1))
            self.slider.setEnabled(len(self._steps) > 1)
            if self._steps:
                step = self._steps[-1] if follows or shown is None else _nearest(self._steps, shown)
                self.slider.setValue(self._steps.index(step))
        others = bool(self._there(self._other))
        self.against.setVisible(others)
        if not others:
            self.against.setCurrentIndex(0)
        self._soon.start()

    def _show(self) -> None:
        step, canvas, handle = self.step, self.canvas, self._handle
        image = None if step is None or handle is None else self._found(handle).get(step)
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
        others = self._there(self._other)
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

    def _quarter(self, handle: JobHandle, path: str, row: int, column: int) -> Painted | None:
        """One quarter of an image file; None if the file cannot be read."""
        if path not in self._files:
            place = handle.picture(path)
            self._files[path] = QImage() if place is None else read_picture(place)
        image = self._files[path]
        if image.isNull():
            return None
        pixels = _quarter(image, row, column)
        alpha = Reading(ALPHA, (pixels & 0xFF) / np.float32(255)) if (row, column) == PARTS["Alpha"] else None
        return Painted(pixels, opaque=True, reading=alpha)


def _quarter(image: QImage, row: int, column: int) -> NDArray[np.uint32]:
    """(H, W) uint32 pixels of one quarter of an image."""
    whole = image.convertToFormat(QImage.Format.Format_RGB32)
    pixels = np.frombuffer(whole.constBits(), np.uint32).reshape(whole.height(), whole.bytesPerLine() // 4)
    height, width = whole.height() // 2, whole.width() // 2
    return pixels[row * height : (row + 1) * height, column * width : (column + 1) * width].copy()


def _nearest(steps: list[int], step: int) -> int:
    return min(steps, key=lambda s: abs(s - step))
