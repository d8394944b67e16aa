"""The frames of the capture: filter them by name, submap, floor, and held-out state, sort them by score, and open one
beside its render."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from PySide6.QtCore import (
    QModelIndex,
    QObject,
    QPersistentModelIndex,
    QPointF,
    QRect,
    QRectF,
    QSignalBlocker,
    QSize,
    Qt,
    Signal,
)
from PySide6.QtGui import QColor, QFontMetrics, QKeyEvent, QPainter, QPalette, QPixmap
from PySide6.QtWidgets import (
    QComboBox,
    QLineEdit,
    QListView,
    QSizePolicy,
    QStyle,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from nvsim.capture.types import Frame
from nvsim_app.frames.link import FrameLink
from nvsim_app.frames.state import FrameState, Score, frame_words, mask_words
from nvsim_app.frames.thumbnails import Thumbnails
from nvsim_app.look import colors
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.icons import swatch
from nvsim_app.look.labels import Hint, Label
from nvsim_app.look.plain_text import tooltip_text
from nvsim_app.look.table import Column, TableModel
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import named
from nvsim_app.painting.primitives import paint_label
from nvsim_app.state.document import Document

KINDS = {
    "All frames": "",
    "Held out": "held out",
    "Trained on": "trained on",
    "Doubtful masks": "doubtful",
    "Corrected": "corrected",
}
ORDERS = {"In order": "", "Worst PSNR": "psnr", "Worst SSIM": "ssim"}
"""Label, and name of the score by which the list is sorted in ascending order; "" for the order of the capture."""
COVERAGES = {
    "Any floor": (-2.0, 2.0),
    "No floor": (-0.5, 0.0005),
    "Up to 10 % floor": (0.0005, 0.1),
    "10 to 30 % floor": (0.1, 0.3),
    "Over 30 % floor": (0.3, 2.0),
}
"""Label and range of the floor share: above the first and up to the second number. Unknown shares count as -1."""
_KIND = (
    "Held out: frames that no model is trained on, for evaluation. Doubtful masks: frames whose floor mask may be "
    "wrong. Corrected: frames with a floor mask edited by hand"
)
_ORDER = "Sort by the render quality of held-out frames; frames without a score come last"


class _List(QListView):
    """The list of frames. chosen(QModelIndex): Return was pressed on a row, or it was double-clicked."""

    chosen = Signal(QModelIndex)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent, uniformItemSizes=True)
        self.setFrameShape(self.Shape.NoFrame)
        self.setVerticalScrollMode(self.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setMouseTracking(True)  # the row under the mouse pointer is highlighted
        self.doubleClicked.connect(self.chosen)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.currentIndex().isValid():
            self.chosen.emit(self.currentIndex())
            return
        super().keyPressEvent(event)


class FramePanel(QWidget):
    """The list of frames with its filters. opened(int): a frame was double-clicked, or Return was pressed on it."""

    opened = Signal(int)

    def __init__(self, document: Document, link: FrameLink | None = None, state: FrameState | None = None) -> None:
        super().__init__()
        self._document = document
        link = link or FrameLink(self)
        self.state = state or FrameState(document, link, self)
        self.thumbnails = Thumbnails(document, link, self)
        self.thumbnails.changed.connect(self._update_rows)
        column = Column("Frame", self._name, icon=self.thumbnails.pixmap)
        self.model: TableModel[int] = TableModel((column,), self, about=self._about)
        self.search = QLineEdit(self, placeholderText="Find a frame by name", clearButtonEnabled=True)
        self.search.setAccessibleName("Find a frame by name")
        document.projectLeft.connect(self.search.clear)
        self.submap = _choice(self, "Show only frames of this submap, with those that it shares with adjacent submaps")
        self.coverage = _choice(self, "Show only frames with this much floor in their mask", COVERAGES)
        self.kind = _choice(self, _KIND, KINDS)
        self.order = _choice(self, _ORDER, ORDERS)
        self.count = Label(self, quiet=True)
        self.list = named(_List(self), "Frames")
        self.list.setModel(self.model)
        self.list.setItemDelegate(FrameDelegate(document, self.state, self.list))
        self.hint = Hint(self.list, self._missing).refresh_with(self.list)
        self.list.selectionModel().currentChanged.connect(self._on_current)
        self.list.chosen.connect(lambda index: self.opened.emit(self.model.row(index.row())))
        self.search.textChanged.connect(self._filter)
        for choice in (self.submap, self.coverage, self.kind, self.order):
            choice.currentIndexChanged.connect(self._filter)
        self.order.currentIndexChanged.connect(self.list.scrollToTop)
        document.selectionChanged.connect(self._show_selection)
        document.contentsChanged.connect(self._on_contents)
        self.state.changed.connect(self._on_state)
        first = hbox((self.search, 1), self.count, spacing=4)
        choices = hbox((self.submap, 1), (self.coverage, 1), spacing=4)
        kinds = hbox((self.kind, 1), (self.order, 1), spacing=4)
        vbox(first, choices, kinds, (self.list, 1), on=self, margins=(4, 4, 4, 0), spacing=4)
        self._on_contents(frozenset({"submaps"}))
        self._on_state()

    @property
    def _frames(self) -> tuple[Frame, ...]:
        """All frames of the capture."""
        capture = self._document.contents.capture
        return () if capture is None else capture.frames

    def _name(self, frame: int) -> str:
        return self._frames[frame].name

    def _about(self, frame: int) -> str:
        return f"{self._frames[frame].image_path}\n{frame_words(self.state, frame)}"

    def _missing(self) -> str:
        if self.model.rowCount():
            return ""
        return "No frame matches the filter." if self._frames else "The frames of the capture appear here."

    def _filter(self, _: object = None) -> None:
        """Lists the frames that match the filter, in the selected order."""
        submap, text, by = self.submap.currentData(), self.search.text().casefold(), self.order.currentData()
        found = [i for i, frame in enumerate(self._frames) if text in frame.name.casefold() and self._matches(i)]
        if submap is not None:
            submaps = self._document.contents.submaps
            members = frozenset(frame for s in submaps if s.index == submap for frame in s.frames)
            found = [frame for frame in found if frame in members]
        if by:
            scores = {frame: self.state.score(frame) for frame in found}
            found.sort(key=lambda frame: getattr(scores[frame], by, math.inf))
        self.model.show(found)
        shown, everything = len(found), len(self._frames)
        self.count.setText(f"{shown:,} of {everything:,}" if shown != everything else f"{everything:,} frames")
        self._show_selection()

    def _matches(self, frame: int) -> bool:
        """Whether a frame has the selected floor share and kind."""
        (above, up_to), kind = self.coverage.currentData(), self.kind.currentData()
        if not above < self.state.coverage.get(frame, -1.0) <= up_to:
            return False
        if kind == "corrected":
            return frame in self.state.corrected
        if kind == "doubtful":
            return frame in self.state.doubtful
        return not kind or (frame in self.state.held_out) == (kind == "held out")

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "capture" in parts:
            self.thumbnails.clear()
        if "submaps" in parts:
            chosen = self.submap.currentData()
            with QSignalBlocker(self.submap):
                self.submap.clear()
                self.submap.addItem("All submaps", None)
                for submap in self._document.contents.submaps:
                    color = colors.submap_color(submap.index)
                    self.submap.addItem(swatch(color), f"Submap {submap.index}", submap.index)
                self.submap.setCurrentIndex(max(0, self.submap.findData(chosen)))
        if parts & {"capture", "submaps"}:
            self._filter()

    def _on_state(self) -> None:
        """Enables sorting by score only if there are scores, and shows the state of the frames."""
        measured = self.state.measured
        if not measured:
            self.order.setCurrentIndex(0)
        self.order.setEnabled(measured)
        why = "no held-out frame was measured; Jobs > Evaluate views measures them"
        self.order.setToolTip(tooltip_text(_ORDER + ("" if measured else f"\nUnavailable: {why}.")))
        if any(choice.currentIndex() > 0 for choice in (self.coverage, self.kind, self.order)):
            self._filter()
        self._update_rows()

    def _update_rows(self) -> None:
        self.list.viewport().update()

    def _on_current(self, current: QModelIndex) -> None:
        if current.isValid():
            self._document.select(frame=self.model.row(current.row()))

    def _show_selection(self) -> None:
        frame = self._document.selection.frame
        places = [] if frame is None else self.model.places_of(frozenset({frame}))
        self.list.setCurrentIndex(self.model.index(places[0], 0) if places else QModelIndex())


def _choice(parent: QWidget, words: str, choices: Mapping[str, object] = MappingProxyType({})) -> QComboBox:
    box = named(QComboBox(parent), tip=words)
    box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
    for text, value in choices.items():
        box.addItem(text, value)
    return box


PICTURE = QSize(84, 63)
_MARGIN = 4
FLOOR = "#2ec4b6"


class FrameDelegate(QStyledItemDelegate):
    """Paints the rows of a list of frames."""

    def __init__(self, document: Document, frames: FrameState, parent: QObject) -> None:
        super().__init__(parent)
        self._document, self._frames = document, frames

    def sizeHint(self, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex) -> QSize:
        return QSize(PICTURE.width() + 100, PICTURE.height() + 2 * _MARGIN)

    def paint(
        self, painter: QPainter, option: QStyleOptionViewItem, index: QModelIndex | QPersistentModelIndex
    ) -> None:
        painter.save()
        rect: QRect = option.rect
        palette: QPalette = option.palette
        state: QStyle.StateFlag = option.state
        selected = bool(state & QStyle.StateFlag.State_Selected)
        if selected:
            painter.fillRect(rect, palette.highlight())
        elif state & QStyle.StateFlag.State_MouseOver:
            painter.fillRect(rect, palette.midlight())
        picture = QRect(rect.left() + _MARGIN, rect.top() + _MARGIN, PICTURE.width(), PICTURE.height())
        _paint_picture(painter, picture, index.data(Qt.ItemDataRole.DecorationRole), palette)
        model = index.model()
        assert isinstance(model, TableModel)
        frame: int = model.row(index.row())
        strip = QRect(picture.left(), picture.top(), 4, picture.height())
        painter.fillRect(strip, QColor(colors.submap_color(int(self._document.trajectory.submaps[frame]))))
        held_out, score = frame in self._frames.held_out, self._frames.score(frame)
        if held_out:
            _paint_mark(painter, picture)

        text_role = QPalette.ColorRole.HighlightedText if selected else QPalette.ColorRole.Text
        quiet = palette.color(text_role)
        quiet.setAlpha(170)
        metrics: QFontMetrics = option.fontMetrics
        left, right = picture.right() + 10, rect.right() - 8
        line = metrics.height() + 2
        lines = 3 if held_out else 2
        top = rect.center().y() - (lines * line + 8) // 2
        painter.setPen(palette.color(text_role))
        name = metrics.elidedText(str(index.data()), Qt.TextElideMode.ElideLeft, right - left)
        painter.drawText(QRect(left, top, right - left, line), Qt.AlignmentFlag.AlignVCenter, name)
        share = self._frames.coverage.get(frame, -1.0)
        painter.setPen(quiet)
        words = mask_words(self._frames, frame)
        if frame in self._frames.corrected:
            words += " · corrected"
        elif frame in self._frames.doubtful:
            words += " · doubtful"
        words = metrics.elidedText(words, Qt.TextElideMode.ElideRight, right - left)
        painter.drawText(QRect(left, top + line, right - left, line), Qt.AlignmentFlag.AlignVCenter, words)
        _paint_bar(painter, QRectF(left, top + 2 * line + 3, right - left, 5), share, palette, selected)
        if held_out:
            painter.setPen(quiet)
            words = _score_words(score, metrics, right - left)
            place = QRect(left, top + 2 * line + 9, right - left, line)
            painter.drawText(place, Qt.AlignmentFlag.AlignVCenter, words)
        painter.restore()


def _score_words(score: Score | None, metrics: QFontMetrics, width: int) -> str:
    if score is None:
        return metrics.elidedText("not evaluated", Qt.TextElideMode.ElideRight, width)
    short = f"{score.psnr:.1f} dB, {score.ssim:.2f}"
    return score.words if metrics.horizontalAdvance(score.words) <= width else short


def _paint_mark(painter: QPainter, picture: QRect) -> None:
    """Marks the thumbnail of a held-out frame."""
    painter.save()
    painter.setFont(type_font("small"))
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    at = QPointF(picture.left() + 7, picture.bottom() - 2)
    paint_label(painter, at, "held out", QColor("#1f2730"), QColor(colors.SELECTED))
    painter.restore()


def _paint_picture(painter: QPainter, place: QRect, pixmap: object, palette: QPalette) -> None:
    if not isinstance(pixmap, QPixmap):
        painter.fillRect(place, palette.alternateBase())
        return
    # Fill the rectangle; crop the longer side equally at both ends.
    scale = max(place.width() / pixmap.width(), place.height() / pixmap.height())
    width, height = place.width() / scale, place.height() / scale
    source = QRectF((pixmap.width() - width) / 2, (pixmap.height() - height) / 2, width, height)
    painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
    painter.drawPixmap(QRectF(place), pixmap, source)


def _paint_bar(painter: QPainter, place: QRectF, share: float, palette: QPalette, selected: bool) -> None:
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.setPen(Qt.PenStyle.NoPen)
    groove = palette.color(QPalette.ColorRole.HighlightedText if selected else QPalette.ColorRole.Text)
    groove.setAlpha(40)
    painter.setBrush(groove)
    painter.drawRoundedRect(place, 2.5, 2.5)
    if share > 0:
        painter.setBrush(palette.highlightedText() if selected else QColor(FLOOR))
        filled = QRectF(place.left(), place.top(), max(place.height(), place.width() * min(share, 1)), place.height())
        painter.drawRoundedRect(filled, 2.5, 2.5)
