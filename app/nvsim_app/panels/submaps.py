"""The submaps of a project: color, number of frames, and the state and quality of the models."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtWidgets import QWidget

from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.icons import swatch
from nvsim_app.look.labels import Hint
from nvsim_app.look.table import Column, TableModel, table
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents


@dataclass(frozen=True)
class SubmapTableRow:
    """One row: the values of a submap, which stay valid when another project is opened."""

    index: int
    frames: int
    overlap: int
    psnr: object
    gaussians: object
    model: str


COLUMNS: tuple[Column[SubmapTableRow], ...] = (
    Column("Submap", lambda row: row.index, tip="Part of the trajectory that is trained as one model",
           icon=lambda row: swatch(colors.submap_color(row.index))),
    Column("Frames", lambda row: row.frames, tip="Frames that belong only to this submap", number=True,
           optional=True),
    Column("Overlap", lambda row: row.overlap, tip="Frames that it shares with adjacent submaps", number=True,
           optional=True),
    Column("PSNR", lambda row: row.psnr, lambda psnr: f"{psnr:.1f}" if isinstance(psnr, int | float) else "–",
           "PSNR in dB; of the training frames if no other value is known", number=True),
    Column("Gaussians", lambda row: row.gaussians,
           lambda count: f"{count / 1000:,.0f} k" if isinstance(count, int) else "–",
           "Number of Gaussians in the trained model", number=True, optional=True),
    Column("Model", lambda row: row.model, lambda words: words.rpartition(" · ")[2],
           "The displayed model, or the state of its training", about=lambda row: row.model),
)  # fmt: skip


class SubmapPanel(QWidget):
    """The table of submaps. Selecting a row selects the submap in the whole window; a double-click moves the camera."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self.model: TableModel[SubmapTableRow] = TableModel(COLUMNS, self, key=lambda row: row.index)
        self.table = table(self.model, self, "Submaps")
        header = self.table.horizontalHeader()
        header.setStretchLastSection(False)  # otherwise the column keeps the width of a wider panel
        header.setSectionResizeMode(len(COLUMNS) - 1, header.ResizeMode.Stretch)
        self.hint = Hint(self.table, self._missing).refresh_with(self.table)
        self.table.selectionModel().selectionChanged.connect(self._on_selected)
        self.model.modelReset.connect(self._show_selection)
        document.selectionChanged.connect(self._show_selection)
        document.contentsChanged.connect(self._on_contents)
        if document.jobs is not None:
            document.jobs.changed.connect(self._refresh)
        vbox(self.table, on=self, margins=0)
        self._refresh()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if parts & {"submaps", "model_info", "stages", "training"}:
            self._refresh()

    def _refresh(self) -> None:
        contents, rows = self._document.contents, []
        for submap in contents.submaps:
            info, core = contents.model_info.get(submap.index, {}), len(submap.core)
            psnr = info.get("psnr", info.get("training_psnr"))
            words = model_words(contents, submap.index, is_training(self._document))
            rows.append(
                SubmapTableRow(submap.index, core, len(submap.frames) - core, psnr, info.get("gaussians"), words)
            )
        self.model.show(rows)

    def _missing(self) -> str:
        return "" if self.model.rowCount() else "Submaps appear here.\nCreate them with Jobs > Cut into submaps."

    def _on_selected(self) -> None:
        rows = self.table.selectionModel().selectedRows()
        if rows:
            self._document.select(submap=self.model.row(rows[0].row()).index)

    def _show_selection(self) -> None:
        chosen = self._document.selection.submap
        if chosen is None:
            self.table.clearSelection()
            return
        for place, row in enumerate(self.model.rows):
            if row.index == chosen:
                self.table.selectRow(place)


_TRAINS = ("train", "run", "demo")


def is_training(document: Document) -> bool:
    """Whether a job trains the models of the project."""
    return document.jobs is not None and any(h.job.order.verb in _TRAINS for h in document.jobs.running)


def model_words(contents: Contents, submap: int, training: bool) -> str:
    """The state of a submap's model, for example "trained, 2000 steps · training, step 430". training: whether a job
    trains models."""
    info, step = contents.model_info.get(submap), contents.training.get(submap)
    if "train" in contents.stages_of_previous_cut:
        words = "models of the previous submaps are shown"
    elif info is not None:
        steps = info.get("steps")
        words = f"trained, {steps} steps" if isinstance(steps, int) else "trained"
    else:
        words = "not trained" if step is None else "shown during training"
    if step is None:
        return words
    return f"{words} · {'training' if training else 'unfinished training'}, step {step}"
