"""The submaps of a project: color, number of frames, and quality of the models."""

from __future__ import annotations

from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.look import colors
from app.look.hint import Hint
from app.look.icons import swatch
from app.look.table import Column, TableModel, table
from app.state.document import Document
from app.state.model_words import model_words
from nvsim.submaps.types import Submap


class SubmapModel(TableModel[int]):
    """One row for each submap of the document: its place in the list of submaps."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        self._document = document
        columns: tuple[Column[int], ...] = (
            Column("Submap", lambda row: self._of(row).index, tip="Part of the trajectory that is trained as one model",
                   icon=lambda row: swatch(colors.submap_color(self._of(row).index))),
            Column("Frames", lambda row: len(self._of(row).core), tip="Frames that belong only to this submap",
                   number=True),
            Column("Overlap", lambda row: len(self._of(row).frames) - len(self._of(row).core), number=True,
                   tip="Frames that it shares with adjacent submaps"),
            Column("PSNR", self._psnr, lambda psnr: f"{psnr:.1f}" if isinstance(psnr, int | float) else "–",
                   "PSNR in dB; of the training frames if no other value is known", number=True),
            Column("Gaussians", lambda row: self._info(row).get("gaussians"),
                   lambda count: f"{count / 1000:,.0f} k" if isinstance(count, int) else "–",
                   "Number of Gaussians in the trained model", number=True),
            Column("Model", lambda row: model_words(document.contents, self._of(row).index),
                   tip="The displayed model, and the state of its training"),
        )  # fmt: skip
        super().__init__(columns, parent)
        document.contentsChanged.connect(self._on_contents)
        self.show(range(len(document.contents.submaps)))

    def _of(self, row: int) -> Submap:
        return self._document.contents.submaps[row]

    def _info(self, row: int) -> dict[str, object]:
        return self._document.contents.model_info.get(self._of(row).index, {})

    def _psnr(self, row: int) -> object:
        return self._info(row).get("psnr", self._info(row).get("training_psnr"))

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & {"submaps", "model_info", "stages", "training", "jobs"}:
            self.show(range(len(self._document.contents.submaps)))


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
        header.setSectionResizeMode(len(self.model.columns) - 1, header.ResizeMode.Stretch)
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
