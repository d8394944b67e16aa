"""The submaps of a project: color, number of frames, and quality of the models."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.look import colors
from app.look.hint import Hint
from app.look.icons import swatch
from app.look.plain_text import tip
from app.look.table import table
from app.state.document import Document
from app.state.model_words import model_words

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
_COLUMNS = ("Submap", "Frames", "Overlap", "PSNR", "Gaussians", "Model")
_TIPS = (
    "Part of the trajectory that is trained as one model",
    "Frames that belong only to this submap",
    "Frames that it shares with adjacent submaps",
    "PSNR in dB; of the training frames if no other value is known",
    "Number of Gaussians in the trained model",
    "The displayed model, and the state of its training",
)


class SubmapModel(QAbstractTableModel):
    """One row for each submap of the document."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        document.contentsChanged.connect(self._on_contents)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & {"submaps", "model_info", "stages", "training", "jobs"}:
            self.beginResetModel()
            self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._document.contents.submaps)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(_COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation == Qt.Orientation.Horizontal and 0 <= section < len(_COLUMNS):
            if role == Qt.ItemDataRole.TextAlignmentRole and section > 0:
                return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
            if role == Qt.ItemDataRole.DisplayRole:
                return _COLUMNS[section]
            if role == Qt.ItemDataRole.ToolTipRole:
                return tip(_TIPS[section])
        return None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= self.rowCount():
            return None
        submap = self._document.contents.submaps[index.row()]
        if role == Qt.ItemDataRole.DecorationRole and index.column() == 0:
            return swatch(colors.submap_color(submap.index))
        if role == Qt.ItemDataRole.TextAlignmentRole and 0 < index.column() < len(_COLUMNS) - 1:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        if role != Qt.ItemDataRole.DisplayRole:
            return None
        info = self._document.contents.model_info.get(submap.index, {})
        psnr, count = info.get("psnr", info.get("training_psnr")), info.get("gaussians")
        return (
            str(submap.index),
            str(len(submap.core)),
            str(len(submap.frames) - len(submap.core)),
            f"{psnr:.1f}" if isinstance(psnr, int | float) else "–",
            f"{count / 1000:,.0f} k" if isinstance(count, int) else "–",
            model_words(self._document.contents, submap.index),
        )[index.column()]


class SubmapPanel(QWidget):
    """The table of submaps. Selecting a row selects the submap in the whole window; a double-click moves the camera."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.model = SubmapModel(document, self)
        self.table = table(self.model, self)
        self.table.setAccessibleName("Submaps")
        header = self.table.horizontalHeader()
        header.setStretchLastSection(False)  # otherwise the column keeps the width of a wider panel
        header.setSectionResizeMode(len(_COLUMNS) - 1, header.ResizeMode.Stretch)
        self.hint = Hint(self.table, self._missing).follow(self.table)
        self.table.selectionModel().selectionChanged.connect(self._on_selected)
        self.model.modelReset.connect(self._show_selection)
        document.selectionChanged.connect(self._show_selection)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.table)

    def _missing(self) -> str:
        return "" if self.model.rowCount() else "Submaps appear here.\nCreate them with Jobs > Cut into submaps."

    def _on_selected(self) -> None:
        rows = self.table.selectionModel().selectedRows()
        if rows:
            self._document.select(submap=self._document.contents.submaps[rows[0].row()].index)

    def _show_selection(self) -> None:
        chosen = self._document.selection.submap
        if chosen is None:
            self.table.clearSelection()
            return
        for row, submap in enumerate(self._document.contents.submaps):
            if submap.index == chosen:
                self.table.selectRow(row)
