"""A capture before its import: the findings of the data check, buttons that fix problems, and an overview with the
trajectory."""

from __future__ import annotations

import math
from collections.abc import Sequence

from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QFormLayout, QHeaderView, QPushButton, QSizePolicy, QTreeWidget, QTreeWidgetItem, QWidget

from nvsim.capture.findings import FindingGroup
from nvsim.capture.summary import Summary
from nvsim.plain_text import capitalized
from nvsim.reconstruction.footage_check import VideoFile
from nvsim_app.jobs.queries import CheckResult
from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import Label, WrappedRows, WrappingRow
from nvsim_app.look.plain_text import in_window, lines, plain, tooltip_text
from nvsim_app.look.widgets import push_button

_COLORS = {"error": "blocked", "warning": "warning", "note": "quiet"}
_SIGNS = {"error": "✗ ", "warning": "⚠ ", "note": ""}
_WORDS = {"error": "must be fixed", "warning": "reduces quality", "note": "for information"}
_MOST_PLACES = 200


class FindingTree(QTreeWidget):
    """One row for each kind of finding. `kinds` are the displayed kinds."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kinds: tuple[FindingGroup, ...] = ()
        self.setHeaderLabels(["Problem", "Where", "Consequence"])
        self.header().setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        for column, width in enumerate((260, 130, 220)):
            self.header().resizeSection(column, width)
        self.header().sectionResized.connect(self.scheduleDelayedItemsLayout)
        self.setItemDelegate(WrappedRows(self))
        self.setWordWrap(True)
        self.setAlternatingRowColors(True)

    @property
    def chosen(self) -> FindingGroup | None:
        """The kind of the selected row or place; None without a selection."""
        items = self.selectedItems()
        if not items:
            return None
        item = items[0].parent() or items[0]
        return self.kinds[self.indexOfTopLevelItem(item)]

    def show_result(self, result: CheckResult) -> None:
        """Replaces the displayed findings."""
        self.clear()
        self.kinds = result.kinds
        for kind in result.kinds:
            many = len(kind.places) > 1
            message = capitalized(kind.message)
            where = f"{len(kind.places)} places" if many else kind.places[0]
            shown = f"{_SIGNS[kind.severity]}{lines(in_window(message))}"
            item = QTreeWidgetItem([shown, plain(where), lines(in_window(kind.consequence))])
            item.setForeground(0, QColor(colors.text(_COLORS.get(kind.severity, "quiet"))))
            tips = (f"{message} ({_WORDS[kind.severity]})", "\n".join(kind.places[:20]), kind.consequence)
            for column, words in enumerate(tips):
                item.setToolTip(column, tooltip_text(words))
            for place in kind.places[:_MOST_PLACES] if many else ():
                item.addChild(QTreeWidgetItem(["", plain(place), ""]))
            self.addTopLevelItem(item)


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
        tip = "Read the poses in the axis convention that matches the images"
        self.axes = push_button("", self, lambda: self.axesWanted.emit(self._axes), tip)
        self.leave_out, self.take_back = QPushButton(self), QPushButton(self)
        self.folder = QPushButton("Folder of the images…", self)
        self.scale = QPushButton("Enter the camera height", self)
        self.folder.setToolTip("Select the folder of the images, if they are not where the capture expects them")
        self.scale.setToolTip("Height of the cameras above the floor in meters; or use Scale, in meters per unit")
        self.leave_out.clicked.connect(lambda: self.leaveOutWanted.emit(self._frames))
        self.take_back.clicked.connect(self.takeBackWanted)
        self.folder.clicked.connect(self.folderWanted)
        self.scale.clicked.connect(self.scaleWanted)
        row = WrappingRow(self.axes, self.folder, self.leave_out, self.scale, self.take_back, on=self)
        row.setContentsMargins(0, 0, 0, 0)
        self.show_fixes(None, None, 0, True)

    def show_fixes(
        self, result: CheckResult | None, chosen: FindingGroup | None, left_out: int, own_images: bool
    ) -> None:
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
        self.leave_out.setToolTip(tooltip_text("Unavailable: no image would be left." if all_of_them else listed))
        self.take_back.setText(f"Include {left_out:,} frame{'' if left_out == 1 else 's'} again")
        self.take_back.setVisible(left_out > 0 and result is not None)
        self.folder.setVisible(result is not None and result.needs_images and own_images)
        self.scale.setVisible(result is not None and (result.needs_scale or result.accepts_scale))
        self._axes = "" if result is None else result.axes
        self.axes.setText(f"Read poses as {self._axes}")
        self.axes.setVisible(bool(self._axes) and own_images)


_MARGIN = 14  # pixels around the trajectory
_BAR = 22  # pixels under it, for the scale
_CLOUDS = {
    "lidar": "LiDAR scan",
    "sfm": "image features",
    "images": "estimated depth",
    "depth": "depth images",
}


class TrajectoryMap(QWidget):
    """The trajectory from above, x to the right and y up. Crosses mark faulty images, and a bar shows the scale."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._summary: Summary | None = None
        self._nothing = "no trajectory"
        self.setMinimumSize(180, 64)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setAccessibleName("Trajectory from above")
        self.setToolTip("Trajectory from above. The dot marks its start; crosses mark images that cannot be used")

    def sizeHint(self) -> QSize:
        return QSize(240, self.minimumHeight())  # the dialog gives it the room that is left

    def show_summary(self, summary: Summary | None, nothing: str = "no trajectory") -> None:
        """Draws the trajectory of `summary`. If it is None, shows the text `nothing`."""
        self._summary, self._nothing = summary, nothing
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(self.palette().mid().color())
        painter.setBrush(self.palette().base())
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), 4, 4)
        summary = self._summary
        if summary is None or not summary.paths:
            painter.setPen(self.palette().placeholderText().color())
            painter.drawText(self.rect(), Qt.AlignmentFlag.AlignCenter, self._nothing)
            return
        places = [place for path in (*summary.paths, summary.faulty) for place in path]
        left, right = min(x for x, _ in places), max(x for x, _ in places)
        low, high = min(y for _, y in places), max(y for _, y in places)
        room = QRectF(self.rect()).adjusted(_MARGIN, _MARGIN, -_MARGIN, -_MARGIN - _BAR)
        pixels = min(room.width() / max(right - left, 1e-6), room.height() / max(high - low, 1e-6))
        middle = room.center()

        def to_pixel(place: tuple[float, float]) -> QPointF:
            x, y = place
            return QPointF(middle.x() + pixels * (x - (left + right) / 2), middle.y() - pixels * (y - (low + high) / 2))

        painter.setBrush(Qt.BrushStyle.NoBrush)
        painter.setPen(QPen(QColor(colors.NODE), 1.6))
        for path in summary.paths:
            painter.drawPolyline(QPolygonF([to_pixel(place) for place in path]))
        painter.setPen(QPen(QColor(colors.text("blocked")), 1.6))
        for spot in map(to_pixel, summary.faulty):
            painter.drawLine(spot + QPointF(-3.5, -3.5), spot + QPointF(3.5, 3.5))
            painter.drawLine(spot + QPointF(-3.5, 3.5), spot + QPointF(3.5, -3.5))
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(self.palette().text())
        for path in summary.paths:
            painter.drawEllipse(to_pixel(path[0]), 3.5, 3.5)
        self._scale(painter, pixels, "m" if summary.scale_known else "units")

    def _scale(self, painter: QPainter, pixels: float, unit: str) -> None:
        length = round_length(0.4 * self.width() / pixels)
        y = self.height() - _BAR / 2 - 2
        painter.setPen(QPen(self.palette().text().color(), 1.5))
        end = _MARGIN + length * pixels
        painter.drawLine(QPointF(_MARGIN, y), QPointF(end, y))
        for x in (_MARGIN, end):
            painter.drawLine(QPointF(x, y - 3), QPointF(x, y + 3))
        painter.drawText(QPointF(end + 6, y + 4), f"{length:g} {unit}")


def round_length(longest: float) -> float:
    """The largest of 1, 2, and 5 times a power of ten that does not exceed `longest`."""
    power = 10.0 ** math.floor(math.log10(longest))
    return max(step * power for step in (1, 2, 5) if step * power <= longest * (1 + 1e-9))


class CaptureSummary(QWidget):
    """The map of the trajectory above the figures of the capture."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.map = TrajectoryMap(self)
        self.rows: dict[str, Label] = {}
        form = QFormLayout(verticalSpacing=4, labelAlignment=Qt.AlignmentFlag.AlignLeft)
        form.setContentsMargins(0, 0, 0, 0)
        for name in (
            "Video",
            "Length",
            "Images",
            "Cameras",
            "Resolution",
            "Trajectory",
            "Point cloud",
            "Depth images",
            "Masks",
            "Left out",
        ):
            value = self.rows[name] = Label(self)
            value.setWordWrap(True)
            value.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
            form.addRow(Label(name, self), value)
        self.form = form
        vbox((self.map, 1), form, on=self, margins=0)
        self.show_summary(None)

    def show_summary(
        self, summary: Summary | None, faulty: int = 0, left_out: int = 0, videos: Sequence[VideoFile] = ()
    ) -> None:
        """Shows the figures of `summary`, or dashes if it is None.

        `faulty` is the number of images that cannot be used. `left_out` is the number of frames that the user excluded.
        `videos` have no poses yet, so only their length and size are shown.
        """
        self.map.show_summary(summary, "the import computes the poses" if videos else "no trajectory")
        words = dict.fromkeys(self.rows, "–") if summary is None else figures(summary, faulty)
        words |= video_figures(videos) if videos else {}
        words["Left out"] = f"{left_out:,} frame{'' if left_out == 1 else 's'}" if left_out else ""
        shown = {"Depth images": summary is not None and summary.depth_images > 0,
                 "Masks": summary is not None and summary.masks > 0, "Left out": left_out > 0,
                 "Video": bool(videos), "Length": bool(videos)}  # fmt: skip
        shown |= {name: not videos for name in ("Images", "Cameras", "Trajectory", "Point cloud")}
        for name, value in self.rows.items():
            value.setText(words.get(name, ""))
        for name, is_shown in shown.items():
            self.form.setRowVisible(self.rows[name], is_shown)


def video_figures(videos: Sequence[VideoFile]) -> dict[str, str]:
    """The figures of `videos` as text, by label."""
    seconds = round(sum(v.seconds for v in videos))
    frames = sum(v.frames for v in videos)
    sizes = dict.fromkeys(f"{v.width} × {v.height}" for v in videos)
    return {
        "Video": videos[0].name if len(videos) == 1 else f"{len(videos):,} videos",
        "Length": f"{seconds // 60} min {seconds % 60:02d} s, {frames:,} frames" if frames else "unknown",
        "Resolution": ", ".join(sizes),
    }


def figures(summary: Summary, faulty: int = 0) -> dict[str, str]:
    """The figures of `summary` as text, by label. `faulty` is the number of images that cannot be used."""
    sizes = [f"{width} × {height}" + (f" ({count:,})" if len(summary.sizes) > 1 else "")
             for width, height, count in summary.sizes[:3]]  # fmt: skip
    unit = "m" if summary.scale_known else "units"
    way = f"{summary.length:.4g} {unit} over {summary.width:.3g} × {summary.depth:.3g}"
    return {
        "Images": f"{summary.images:,}" + (f", {faulty:,} cannot be used" if faulty else ""),
        "Cameras": f"{summary.cameras:,}",
        "Resolution": ", ".join([*sizes, "…"][: len(summary.sizes) if len(summary.sizes) <= 3 else 4]) or "unknown",
        "Trajectory": way if summary.paths else "no image has a pose",
        "Point cloud": f"{summary.points:,} points, {_CLOUDS.get(summary.cloud, '')}" if summary.points else "none",
        "Depth images": f"{summary.depth_images:,}",
        "Masks": f"{summary.masks:,}",
    }
