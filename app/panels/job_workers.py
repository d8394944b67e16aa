"""The workers of a job that runs on a cluster, and the part that each one computes. Hidden for other jobs."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QVBoxLayout, QWidget

from app.jobs.queue import JobHandle
from app.look import colors
from app.look.plain_text import plain, tip
from app.panels.job_table import clock
from app.panels.submaps import table

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
COLUMNS = ("Worker", "Works on", "State", "Since")
_STATE = 2
_COLORS = {"works": "running", "lost": "blocked"}
_WORDS = {"works": "works", "ended": "idle", "lost": "lost"}


class WorkerModel(QAbstractTableModel):
    """One row for each worker, working ones first."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.rows: list[tuple[str, str, str, str]] = []

    def show_rows(self, rows: list[tuple[str, str, str, str]]) -> None:
        """Replaces the rows."""
        if rows != self.rows:
            self.beginResetModel()
            self.rows = rows
            self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self.rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return COLUMNS[section] if 0 <= section < len(COLUMNS) else None
        return None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= len(self.rows):
            return None
        row = self.rows[index.row()]
        if role == Qt.ItemDataRole.ForegroundRole and index.column() == _STATE:
            return QColor(colors.text(_COLORS.get(row[_STATE], "quiet")))
        if role == Qt.ItemDataRole.ToolTipRole:
            return tip(f"{row[0]}: {row[1]}, {row[2]}")
        return plain(row[index.column()]) if role == Qt.ItemDataRole.DisplayRole else None


class JobWorkers(QWidget):
    """The table of the selected job's workers."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self.model = WorkerModel(self)
        self.table = table(self.model, self)
        self.table.setAccessibleName("Workers")
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.table)

    def show_job(self, handle: JobHandle | None) -> None:
        """Shows the workers of this job."""
        self._handle = handle
        self.refresh()

    @property
    def any(self) -> bool:
        """Whether the job has workers."""
        return self._handle is not None and bool(self._handle.history.workers)

    def refresh(self) -> None:
        """Updates the rows."""
        handle = self._handle
        found = [] if handle is None else list(handle.history.workers.values())
        running = handle is not None and handle.running
        rows = []
        for at, worker in sorted(found, key=lambda row: (row[1].state != "works", row[1].name)):
            state = _WORDS.get(worker.state, worker.state) if running or worker.state == "lost" else "gone"
            rows.append((worker.name, worker.words if state in ("works", "lost") else "–", state, clock(at)))
        self.model.show_rows(rows)
