"""What runs or ran on the project."""

from __future__ import annotations

import time
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, QRect, Qt
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QStyledItemDelegate, QStyleOptionViewItem, QVBoxLayout, QWidget

from app import colors
from app.document import Document
from app.panels.submaps import table
from nvsim.project.jobs import JobRecord

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
_COLUMNS = ("Stage", "State", "Progress", "Started", "Took", "Note")
_PROGRESS = 2
_STATE_TEXTS = {
    "running": colors.RUNNING_TEXT,
    "done": colors.OPEN_TEXT,
    "failed": colors.BLOCKED_TEXT,
    "interrupted": colors.WARNING_TEXT,
    "stopped": colors.QUIET_TEXT,
}
_STATE_COLORS = {
    "running": colors.NODE,
    "done": colors.OPEN,
    "failed": colors.BLOCKED,
    "interrupted": colors.SELECTED,
    "stopped": colors.UNDECIDED,
}


def duration(seconds: float) -> str:
    """ "42 s", "3 min 05 s", "1 h 02 min"."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


class JobModel(QAbstractTableModel):
    """A row for each job, newest first; rows are renewed in place while a job runs."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._jobs: tuple[JobRecord, ...] = document.contents.jobs
        document.contentsChanged.connect(self._on_contents)

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "jobs" not in parts:
            return
        jobs = self._document.contents.jobs
        if [j.id for j in jobs] == [j.id for j in self._jobs]:
            self._jobs = jobs
            if jobs:
                self.dataChanged.emit(self.index(0, 0), self.index(len(jobs) - 1, len(_COLUMNS) - 1))
            return
        self.beginResetModel()
        self._jobs = jobs
        self.endResetModel()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._jobs)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(_COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation == Qt.Orientation.Horizontal and role == Qt.ItemDataRole.DisplayRole:
            return _COLUMNS[section] if 0 <= section < len(_COLUMNS) else None
        return None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= len(self._jobs):
            return None
        job = self._jobs[index.row()]
        if role == Qt.ItemDataRole.ForegroundRole and index.column() == 1:
            return QColor(_STATE_TEXTS.get(job.state, colors.QUIET_TEXT))
        if role == Qt.ItemDataRole.ToolTipRole:
            return job.message or None
        if role == Qt.ItemDataRole.UserRole and index.column() == _PROGRESS:
            return job.progress
        if role != Qt.ItemDataRole.DisplayRole:
            return None
        took = (job.finished or time.time()) - job.started
        return (
            job.stage,
            job.state,
            f"{100 * job.progress:.0f} %",
            time.strftime("%H:%M", time.localtime(job.started)),
            duration(took) if job.finished or job.state == "running" else "–",
            job.message,
        )[index.column()]


class _ProgressBar(QStyledItemDelegate):
    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: _Index) -> None:
        share = min(max(float(index.data(Qt.ItemDataRole.UserRole) or 0), 0.0), 1.0)
        state = index.siblingAtColumn(1).data()
        box = option.rect.adjusted(6, 8, -6, -8)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(
            option.palette.mid() if option.palette.window().color().lightness() > 128 else QColor("#39414b")
        )
        painter.drawRoundedRect(box, 4, 4)
        painter.setBrush(QColor(_STATE_COLORS.get(str(state), colors.UNDECIDED)))
        painter.drawRoundedRect(QRect(box.left(), box.top(), round(box.width() * share), box.height()), 4, 4)
        painter.restore()


class JobPanel(QWidget):
    """The list of jobs."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.model = JobModel(document, self)
        self.table = table(self.model, self)
        self.table.setItemDelegateForColumn(_PROGRESS, _ProgressBar(self.table))
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(_PROGRESS, header.ResizeMode.Fixed)
        header.resizeSection(_PROGRESS, 140)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.table)
