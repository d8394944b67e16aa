"""The frames of the capture: filter them by name, submap, floor, and held-out state, sort them by score, and open one
beside its render."""

from __future__ import annotations

from PySide6.QtCore import QModelIndex, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import (
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
from app.frames.model import COVERAGES, KINDS, ORDERS, FrameFilter, FrameModel
from app.frames.state import FrameState
from app.frames.thumbnails import Thumbnails
from app.look import colors
from app.look.hint import Hint
from app.look.icons import swatch
from app.look.labels import Label
from app.look.plain_text import tip
from app.state.document import Document

_KIND = (
    "Held out: frames that no model is trained on, for evaluation. Corrected: frames with a floor mask edited by hand"
)
_ORDER = "Sort by the render quality of held-out frames; frames without a score come last"


class _List(QListView):
    """The list of frames. chosen(QModelIndex): Return was pressed on a row, or it was double-clicked."""

    chosen = Signal(QModelIndex)

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setUniformItemSizes(True)
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
        self.submap = _choice(self, "Show only frames of this submap, with those that it shares with adjacent submaps")
        self.submap.currentIndexChanged.connect(lambda _: self.filter.show_submap(self.submap.currentData()))
        self.coverage = _choice(self, "Show only frames with this much floor in their mask")
        for words, above, up_to in COVERAGES:
            self.coverage.addItem(words, (above, up_to))
        self.coverage.currentIndexChanged.connect(lambda _: self.filter.show_coverage(*self.coverage.currentData()))
        self.kind = _choice(self, _KIND)
        for words, kind in KINDS:
            self.kind.addItem(words, kind)
        self.kind.currentIndexChanged.connect(lambda _: self.filter.show_kind(self.kind.currentData()))
        self.order = _choice(self, _ORDER)
        for words, by in ORDERS:
            self.order.addItem(words, by)
        self.order.currentIndexChanged.connect(lambda _: self._on_order())
        self.count = Label(self)
        self.count.setForegroundRole(self.count.palette().ColorRole.PlaceholderText)
        self.list = _List(self)
        self.list.setAccessibleName("Frames")
        self.list.setModel(self.filter)
        self.list.setItemDelegate(FrameDelegate(self.list))
        self.hint = Hint(self.list, self._missing).follow(self.list)
        self.list.selectionModel().currentChanged.connect(self._on_current)
        self.list.chosen.connect(lambda index: self.opened.emit(self.filter.mapToSource(index).row()))
        # A filter that hides the selected row makes another row current, which is not the user's choice.
        self._filtering = False
        for begins in (self.filter.layoutAboutToBeChanged, self.filter.rowsAboutToBeRemoved):
            begins.connect(lambda: self._set_filtering(True))
        for ends in (self.filter.layoutChanged, self.filter.rowsRemoved, self.filter.rowsInserted):
            ends.connect(lambda: self._set_filtering(False))
        self.filter.modelReset.connect(self._say_count)
        document.selectionChanged.connect(self._show_selection)
        document.contentsChanged.connect(self._on_contents)
        self.state.changed.connect(self._offer_order)
        first, choices, kinds = QHBoxLayout(), QHBoxLayout(), QHBoxLayout()
        for row in (first, choices, kinds):
            row.setSpacing(4)
        choices.addWidget(self.submap, 1)
        choices.addWidget(self.coverage, 1)
        kinds.addWidget(self.kind, 1)
        kinds.addWidget(self.order, 1)
        first.addWidget(self.search, 1)
        first.addWidget(self.count)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 0)
        layout.setSpacing(4)
        layout.addLayout(first)
        layout.addLayout(choices)
        layout.addLayout(kinds)
        layout.addWidget(self.list, 1)
        self._on_contents(frozenset({"submaps"}))
        self._offer_order()
        self._say_count()

    def _missing(self) -> str:
        if self.filter.rowCount():
            return ""
        all_frames = self.model.rowCount()
        return "No frame matches the filter." if all_frames else "The frames of the capture appear here."

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

    def _on_order(self) -> None:
        self.filter.show_order(self.order.currentData())
        self.list.scrollToTop()

    def _offer_order(self) -> None:
        """Enables sorting by score only if there are scores."""
        measured = self.state.measured
        if not measured:
            self.order.setCurrentIndex(0)
        self.order.setEnabled(measured)
        why = "no held-out frame was measured; Jobs > Evaluate views measures them"
        self.order.setToolTip(tip(_ORDER + ("" if measured else f"\nUnavailable: {why}.")))

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
