"""The table of jobs: those that were ordered in the window, and those that were started in a terminal."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, QRect, Qt
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QStyledItemDelegate, QStyleOptionViewItem, QWidget

from app.jobs.queue import JobHandle, JobQueue
from app.look import colors
from app.look.plain_text import plain, tip
from app.state.document import Document
from nvsim.project.jobs.commands import JobRecord
from nvsim.project.jobs.files import Ran, State

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
COLUMNS = ("Job", "State", "Progress", "Time left", "Rate", "Duration", "Started", "Note")
STATE, PROGRESS, NOTE = 1, 2, 7
_RIGHT = (3, 4, 5)
_STATE_TEXTS = {
    "running": "running",
    "done": "open",
    "failed": "blocked",
    "interrupted": "warning",
    "paused": "warning",
    "foreign": "warning",
}
STATE_WORDS = {"foreign": "ordered elsewhere"}
"""Labels of states whose label differs from their name."""
_STATE_COLORS = {
    "running": colors.NODE,
    "done": colors.OPEN,
    "failed": colors.BLOCKED,
    "interrupted": colors.SELECTED,
    "paused": colors.SELECTED,
}


def duration(seconds: float) -> str:
    """For example "42 s", "3 min 05 s", or "1 h 02 min"."""
    whole = max(0, round(seconds))
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def clock(at: float | None) -> str:
    """For example "14:05", with the date if it is not today."""
    if not at:
        return "–"
    then, now = time.localtime(at), time.localtime()
    return time.strftime("%H:%M" if then[:3] == now[:3] else "%d %b %H:%M", then)


@dataclass(frozen=True)
class Row:
    """One row of the table. `handle` is None for a job that was started in a terminal."""

    key: str
    handle: JobHandle | None
    title: str
    state: State | Ran
    share: float
    rate: float | None
    left: float | None
    started: float | None
    took: float | None
    note: str

    @staticmethod
    def of_handle(handle: JobHandle) -> Row:
        running, status, history = handle.running, handle.job.status, handle.history
        share = 1.0 if handle.state == "done" else 0.0 if handle.state == "foreign" else history.share
        return Row(
            f"job {handle.number}",
            handle,
            handle.title,
            handle.state,
            share,
            history.rate if running else None,
            history.seconds_left if running else None,
            status.started or (handle.job.order.ordered if handle.state in ("queued", "foreign") else None),
            handle.worked if handle.worked else None,
            handle.message,
        )

    @staticmethod
    def of_record(record: JobRecord) -> Row:
        took = (record.finished or time.time()) - record.started
        known = record.finished or record.state == "running"
        return Row(
            f"record {record.id}", None, record.stage, record.state, record.progress, None, None,
            record.started, took if known else None, record.message,
        )  # fmt: skip


class JobModel(QAbstractTableModel):
    """One row for each job: running jobs first, then queued jobs, then the newest. Rows are updated in place."""

    def __init__(self, document: Document, queue: JobQueue | None = None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document, self._queue = document, queue
        self.rows: list[Row] = self._gather()
        document.contentsChanged.connect(self._on_contents)
        if queue is not None:
            queue.changed.connect(self.refresh)
            queue.progressed.connect(self.refresh)

    def _gather(self) -> list[Row]:
        handles = [] if self._queue is None else self._queue.handles
        ran = {} if self._queue is None else self._queue.ran
        rows = [Row.of_handle(h) for h in handles]
        rows += [
            Row.of_record(r)
            for r in self._document.contents.jobs
            if not (r.pid in ran and r.started >= ran[r.pid] - 1.0)
        ]
        return sorted(rows, key=lambda r: (r.state != "running", r.state != "queued", -(r.started or 0.0)))

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "jobs" in parts:
            self.refresh()

    def refresh(self) -> None:
        """Updates the rows."""
        rows = self._gather()
        if [r.key for r in rows] == [r.key for r in self.rows]:
            self.rows = rows
            if rows:
                self.dataChanged.emit(self.index(0, 0), self.index(len(rows) - 1, len(COLUMNS) - 1))
            return
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
        row, column = self.rows[index.row()], index.column()
        if role == Qt.ItemDataRole.ForegroundRole and column == STATE:
            return QColor(colors.text(_STATE_TEXTS.get(row.state, "quiet")))
        if role == Qt.ItemDataRole.ToolTipRole:
            return tip(row.note) or None
        if role == Qt.ItemDataRole.UserRole and column == PROGRESS:
            return row.share
        if role == Qt.ItemDataRole.TextAlignmentRole and column in _RIGHT:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        if role != Qt.ItemDataRole.DisplayRole:
            return None
        return (
            plain(row.title),
            plain(STATE_WORDS.get(row.state, row.state)),
            f"{100 * row.share:.0f} %",
            "" if row.left is None else duration(row.left),
            "" if row.rate is None else f"{row.rate:.{1 if row.rate < 100 else 0}f} /s",
            "–" if row.took is None else duration(row.took),
            clock(row.started),
            plain(row.note),
        )[column]


class ProgressBar(QStyledItemDelegate):
    """Draws the progress of a job in the color of its state."""

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: _Index) -> None:
        share = min(max(float(index.data(Qt.ItemDataRole.UserRole) or 0), 0.0), 1.0)
        state = index.model().index(index.row(), STATE).data()
        box = option.rect.adjusted(6, 8, -6, -8)
        painter.save()
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        light = option.palette.window().color().lightness() > 128
        painter.setBrush(option.palette.mid() if light else QColor("#39414b"))
        painter.drawRoundedRect(box, 4, 4)
        painter.setBrush(QColor(_STATE_COLORS.get(str(state), colors.UNDECIDED)))
        painter.drawRoundedRect(QRect(box.left(), box.top(), round(box.width() * share), box.height()), 4, 4)
        painter.restore()
