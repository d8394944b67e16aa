"""Buttons that fix problems of a capture: leave out frames, select the image folder, enter the scale, or read the poses
in another axis convention."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QPushButton, QWidget

from app.jobs.check import CheckResult
from app.look.plain_text import tip
from app.look.wrapping import WrappingRow
from nvsim.capture.findings import Kind


class CaptureFixes(QWidget):
    """Offers the fixes that apply to the result of a check.

    Signals: leaveOutWanted(tuple of frame names), takeBackWanted(), folderWanted(), scaleWanted(), axesWanted(name).
    """

    leaveOutWanted = Signal(object)
    takeBackWanted = Signal()
    folderWanted = Signal()
    scaleWanted = Signal()
    axesWanted = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._frames: tuple[str, ...] = ()
        self._axes = ""
        self.axes = QPushButton(self)
        self.axes.setToolTip("Read the poses in the axis convention that matches the images")
        self.axes.clicked.connect(lambda: self.axesWanted.emit(self._axes))
        self.leave_out, self.take_back = QPushButton(self), QPushButton(self)
        self.folder = QPushButton("Folder of the images…", self)
        self.scale = QPushButton("Enter the camera height", self)
        self.folder.setToolTip("Select the folder of the images, if they are not where the capture expects them")
        self.scale.setToolTip("Height of the cameras above the floor in meters; or use Scale, in meters per unit")
        self.leave_out.clicked.connect(lambda: self.leaveOutWanted.emit(self._frames))
        self.take_back.clicked.connect(self.takeBackWanted)
        self.folder.clicked.connect(self.folderWanted)
        self.scale.clicked.connect(self.scaleWanted)
        row = WrappingRow(self)
        row.setContentsMargins(0, 0, 0, 0)
        for button in (self.axes, self.folder, self.leave_out, self.scale, self.take_back):
            row.addWidget(button)
        self.offer(None, None, 0, True)

    def offer(self, result: CheckResult | None, chosen: Kind | None, left_out: int, own_images: bool) -> None:
        """Shows the buttons that fix `result`; None hides all buttons.

        The frames to leave out are those of the `chosen` finding if it has any, otherwise all frames with errors.
        `left_out` counts the frames that are already left out. `own_images` says whether the image folder and the axis
        convention can be changed.
        """
        frames = () if result is None else result.bad_frames
        if result is not None and chosen is not None and chosen.frames:
            frames = chosen.frames
        self._frames = frames
        self.leave_out.setText(f"Leave out {len(frames):,} frame{'' if len(frames) == 1 else 's'}")
        self.leave_out.setVisible(bool(frames))
        summary = None if result is None else result.summary
        all_of_them = summary is not None and len(frames) >= summary.images
        self.leave_out.setEnabled(not all_of_them)
        listed = "\n".join(frames[:20]) + ("\n…" if len(frames) > 20 else "")
        self.leave_out.setToolTip(tip("Unavailable: no image would be left." if all_of_them else listed))
        self.take_back.setText(f"Include {left_out:,} frame{'' if left_out == 1 else 's'} again")
        self.take_back.setVisible(left_out > 0 and result is not None)
        self.folder.setVisible(result is not None and result.wants_images and own_images)
        self.scale.setVisible(result is not None and (result.wants_scale or result.assumes_scale))
        self._axes = "" if result is None else result.axes
        self.axes.setText(f"Read poses as {self._axes}")
        self.axes.setVisible(bool(self._axes) and own_images)
