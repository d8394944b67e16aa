"""The frames of the capture: find them by name, submap and floor, and open one beside the render from its camera."""

from __future__ import annotations

from PySide6.QtCore import QModelIndex, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QLineEdit,
    QListView,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from app.frames.delegate import FrameDelegate
from app.frames.link import FrameLink
from app.frames.model import COVERAGES, FrameFilter, FrameModel
from app.frames.state import FrameState
from app.frames.thumbnails import Thumbnails
from app.look import colors
from app.look.hint import Hint
from app.look.icons import swatch
from app.look.labels import Label
from app.look.plain_text import tip
from app.state.document import Document


class _List(QListView):
    """chosen(QModelIndex): Return was pressed on a row, or it was double-clicked."""

    chosen = Signal(QModelIndex)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setUniformItemSizes(True)
        self.setFrameShape(self.Shape.NoFrame)
        self.setVerticalScrollMode(self.ScrollMode.ScrollPerPixel)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setMouseTracking(True)  # rows under the cursor are lit
        self.doubleClicked.connect(self.chosen)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self.currentIndex().isValid():
            self.chosen.emit(self.currentIndex())
            return
        super().keyPressEvent(event)


class FramePanel(QWidget):
    """opened(int): a frame was double-clicked, or Return was pressed on it."""

    opened = Signal(int)

    def __init__(
        self,
        document: Document,
        link: FrameLink | None = None,
        state: FrameState | None = None,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._document = document
        link = link or FrameLink(self)
        self.state = state or FrameState(document, link, self)
        self.thumbnails = Thumbnails(document, link, self)
        self.model = FrameModel(document, self.thumbnails, self.state, self)
        self.filter = FrameFilter(document, self)
        self.filter.setSourceModel(self.model)
        self.search = QLineEdit(self)
        self.search.setAccessibleName("Find a frame by name")
        self.search.setPlaceholderText("Find a frame by name")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(self.filter.show_name)
        self.submap = _choice(self, "Only frames of this submap, with those it shares with its neighbours")
        self.submap.currentIndexChanged.connect(lambda _: self.filter.show_submap(self.submap.currentData()))
        self.coverage = _choice(self, "Only frames whose mask shows this much floor")
        for words, above, up_to in COVERAGES:
            self.coverage.addItem(words, (above, up_to))
        self.coverage.currentIndexChanged.connect(lambda _: self.filter.show_coverage(*self.coverage.currentData()))
        self.corrected = QCheckBox("Corrected", self)
        self.corrected.setToolTip("Only frames whose floor mask was corrected by hand")
        self.corrected.toggled.connect(self.filter.show_corrected_only)
        self.count = Label(self)
        self.count.setForegroundRole(self.count.palette().ColorRole.PlaceholderText)
        self.list = _List(self)
        self.list.setAccessibleName("Frames")
        self.list.setModel(self.filter)
        self.list.setItemDelegate(FrameDelegate(self.list))
        self.hint = Hint(self.list, self._missing).follow(self.list)
        self.list.selectionModel().currentChanged.connect(self._on_current)
        self.list.chosen.connect(lambda index: self.opened.emit(self.filter.mapToSource(index).row()))
        # A filter that hides the selected row makes another one current; that is not the user's choice.
        self._filtering = False
        for begins in (self.filter.layoutAboutToBeChanged, self.filter.rowsAboutToBeRemoved):
            begins.connect(lambda: self._set_filtering(True))
        for ends in (self.filter.layoutChanged, self.filter.rowsRemoved, self.filter.rowsInserted):
            ends.connect(lambda: self._set_filtering(False))
        self.filter.modelReset.connect(self._say_count)
        document.selectionChanged.connect(self._show_selection)
        document.contentsChanged.connect(self._on_contents)
        choices, rest = QHBoxLayout(), QHBoxLayout()
        for row in (choices, rest):
            row.setSpacing(4)
        choices.addWidget(self.submap, 1)
        choices.addWidget(self.coverage, 1)
        rest.addWidget(self.corrected)
        rest.addStretch(1)
        rest.addWidget(self.count)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 0)
        layout.setSpacing(4)
        layout.addWidget(self.search)
        layout.addLayout(choices)
        layout.addLayout(rest)
        layout.addWidget(self.list, 1)
        self._on_contents(frozenset({"submaps"}))
        self._say_count()

    def _missing(self) -> str:
        if self.filter.rowCount():
            return ""
        all_frames = self.model.rowCount()
        return "No frame fits the filter." if all_frames else "The frames of the capture appear here, with their floor."

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "submaps" not in parts:
            return
        chosen = self.submap.currentData()
        with QSignalBlocker(self.submap):
            self.submap.clear()
            self.submap.addItem("All submaps", None)
            for submap in self._document.contents.submaps:
                self.submap.addItem(swatch(colors.submap_color(submap.index)), f"Submap {submap.index}", submap.index)
            found = self.submap.findData(chosen)
            self.submap.setCurrentIndex(max(0, found))
        if found < 0 and chosen is not None:
            self.filter.show_submap(None)

    def _set_filtering(self, filtering: bool) -> None:
        self._filtering = filtering
        if not filtering:
            self._say_count()
            self._show_selection()

    def _say_count(self) -> None:
        shown, all_frames = self.filter.rowCount(), self.model.rowCount()
        self.count.setText(f"{shown:,} of {all_frames:,}" if shown != all_frames else f"{all_frames:,} frames")

    def _on_current(self, current: QModelIndex) -> None:
        if current.isValid() and not self._filtering:
            self._document.select(frame=self.filter.mapToSource(current).row())

    def _show_selection(self) -> None:
        frame = self._document.selection.frame
        if frame is None:
            self.list.setCurrentIndex(QModelIndex())
            return
        self.list.setCurrentIndex(self.filter.mapFromSource(self.model.index(frame)))


def _choice(parent: QWidget, words: str) -> QComboBox:
    box = QComboBox(parent)
    box.setToolTip(tip(words))
    box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
    return box
