"""Images of any size, and the camera path: key poses in order, played in the view and rendered as a video."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QListWidget, QPushButton, QWidget

from nvsim_app.look import lengths
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import Hint, Label, WrappingRow
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.widgets import NumberBox, named
from nvsim_app.painting.cameras import ViewPose, heading_degrees


class CameraPathPanel(QWidget):
    """The controls of the camera path.

    Signals: added(), removed(row), chosen(row), played(bool), pictureWanted(), videoWanted().
    """

    added = Signal()
    removed = Signal(int)
    chosen = Signal(int)
    played = Signal(bool)
    pictureWanted = Signal()
    videoWanted = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("cameraPathPanel")
        self.width_box = NumberBox("Width", 16, 8192, 1920, 0, suffix=" px")
        self.height_box = NumberBox("Height", 16, 8192, 1080, 0, suffix=" px")
        self.layers = named(QCheckBox("With layers"), tip="Draw the visible layers over the image")
        self.layers.setChecked(True)
        self.picture = named(QPushButton("Save image…"), tip="Render the view in this size and save it")
        self.keys = named(QListWidget(), "Views of the path", "Double-click to go there")
        self.hint = Hint(self.keys, self._missing).refresh_with(self.keys)
        self.add, self.remove = QPushButton("Add view"), QPushButton("Remove")
        self.add.setToolTip("Add the current view as the next key pose")
        self.play = QPushButton("Play")
        self.play.setCheckable(True)
        self.seconds = NumberBox("Length of the video", 1, 600, 10, suffix=" s")
        self.fps = NumberBox("Frames per second", 1, 120, 30, 0, suffix=" /s")
        self.video = QPushButton("Render video…")
        self._lay_out()
        self.picture.clicked.connect(lambda: self.pictureWanted.emit())
        self.add.clicked.connect(lambda: self.added.emit())
        self.remove.clicked.connect(lambda: self.removed.emit(self.keys.currentRow()))
        self.keys.itemDoubleClicked.connect(lambda item: self.chosen.emit(self.keys.row(item)))
        self.play.toggled.connect(self.played)
        self.video.clicked.connect(lambda: self.videoWanted.emit())
        self.show_keys([])

    @property
    def size_wanted(self) -> tuple[int, int]:
        """Width and height of the image in pixels."""
        return int(self.width_box.value()), int(self.height_box.value())

    def _missing(self) -> str:
        return "" if self.keys.count() else "Add views here. The camera flies from one to the next, also in a video."

    def show_keys(self, poses: list[ViewPose]) -> None:
        """Lists the key poses."""
        row = self.keys.currentRow()
        self.keys.clear()
        for number, pose in enumerate(poses, 1):
            x, y, z = pose.position
            self.keys.addItem(f"{number}   {lengths.position_text(x, y, z, decimals=1)}   {heading_degrees(pose):.0f}°")
        self.keys.setCurrentRow(min(row, len(poses) - 1))
        enough = len(poses) >= 2
        self.remove.setEnabled(bool(poses))
        for button, words in (
            (self.play, "Fly along the path"),
            (self.video, "Render the path as PNG frames and an MP4"),
        ):
            button.setEnabled(enough)
            button.setToolTip(
                tooltip_text(words if enough else f"{words}\nUnavailable: a path needs at least two key poses.")
            )

    def _lay_out(self) -> None:
        size = QGridLayout()
        size.addWidget(Label("Size"), 0, 0)
        size.addWidget(self.width_box, 0, 1)
        size.addWidget(Label("×"), 0, 2)
        size.addWidget(self.height_box, 0, 3)
        size.setColumnStretch(4, 1)
        picture = WrappingRow(self.layers, self.picture)
        keys = WrappingRow(self.add, self.remove, self.play)
        video = WrappingRow(self.seconds, self.fps, self.video)
        vbox(size, picture, (self.keys, 1), keys, video, on=self, margins=8)
