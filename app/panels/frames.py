"""The frames of the walk: find one by name, stand where it was taken."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import (
    QAbstractListModel,
    QModelIndex,
    QPersistentModelIndex,
    QSortFilterProxyModel,
    Qt,
    Signal,
)
from PySide6.QtWidgets import QLineEdit, QListView, QVBoxLayout, QWidget

from app import colors
from app.document import Document
from app.icons import swatch

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()


class FrameModel(QAbstractListModel):
    """A row for each frame of the capture, with the colour of the submap that owns it."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._swatches: dict[int, Any] = {}
        document.contentsChanged.connect(self._on_contents)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & {"capture", "submaps"}:
            self.beginResetModel()
            self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        capture = self._document.contents.capture
        return 0 if parent.isValid() or capture is None else len(capture.frames)

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        capture = self._document.contents.capture
        if capture is None or not index.isValid() or index.row() >= len(capture.frames):
            return None
        if role == Qt.ItemDataRole.DisplayRole:
            return capture.frames[index.row()].name
        if role == Qt.ItemDataRole.ToolTipRole:
            return str(capture.frames[index.row()].image_path)
        if role == Qt.ItemDataRole.DecorationRole:
            owner = int(self._document.trajectory.submaps[index.row()])
            if owner not in self._swatches:
                self._swatches[owner] = swatch(colors.submap_color(owner))
            return self._swatches[owner]
        return None


class FramePanel(QWidget):
    """opened(int): a frame was double-clicked."""

    opened = Signal(int)

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.model = FrameModel(document, self)
        self._filtered = QSortFilterProxyModel(self)
        self._filtered.setSourceModel(self.model)
        self._filtered.setFilterCaseSensitivity(Qt.CaseSensitivity.CaseInsensitive)
        self.search = QLineEdit(self)
        self.search.setPlaceholderText("Find a frame by name")
        self.search.setClearButtonEnabled(True)
        self.search.textChanged.connect(self._filtered.setFilterFixedString)
        self.list = QListView(self)
        self.list.setModel(self._filtered)
        self.list.setUniformItemSizes(True)
        self.list.setFrameShape(self.list.Shape.NoFrame)
        self.list.selectionModel().currentChanged.connect(self._on_current)
        self.list.doubleClicked.connect(lambda index: self.opened.emit(self._filtered.mapToSource(index).row()))
        document.selectionChanged.connect(self._show_selection)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(4, 4, 4, 0)
        layout.setSpacing(4)
        layout.addWidget(self.search)
        layout.addWidget(self.list)

    def _on_current(self, current: QModelIndex) -> None:
        if current.isValid():
            self._document.select(frame=self._filtered.mapToSource(current).row())

    def _show_selection(self) -> None:
        frame = self._document.selection.frame
        if frame is None:
            self.list.setCurrentIndex(QModelIndex())
            return
        self.list.setCurrentIndex(self._filtered.mapFromSource(self.model.index(frame)))
