"""The table of jobs: those that were ordered in the window, and those that were started in a terminal."""

from __future__ import annotations

import time
from collections.abc import Hashable
from dataclasses import dataclass

from PySide6.QtCore import QRect, Qt, Signal
from PySide6.QtGui import QColor, QPainter
from PySide6.QtWidgets import QStyledItemDelegate, QStyleOptionViewItem, QWidget

from app.jobs.queue import JobHandle, JobQueue
from app.look import colors
from app.look.table import Column, Index, TableModel
from app.state.document import Document
from nvsim.project.jobs.commands import JobRecord
from nvsim.project.jobs.files import Ran, State

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
    """One row of the table.

    key      the handle, which stays the same while the project is open
    ordered  time of the order, seconds since the epoch
    handle   None for a job that was started in a terminal
    """

    key: Hashable
    ordered: float
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
            handle,
            handle.job.order.ordered,
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
            record.id, record.started, None, record.stage, record.state, record.progress, None, None,
            record.started, took if known else None, record.message,
        )  # fmt: skip


def _rate(rate: float | None) -> str:
    return "" if rate is None else f"{rate:.{1 if rate < 100 else 0}f} /s"


COLUMNS: tuple[Column[Row], ...] = (
    Column("Job", lambda row: row.title, width=118),
    Column("State", lambda row: row.state, lambda state: STATE_WORDS.get(state, state), width=84,
           ink=lambda row: colors.text(_STATE_TEXTS.get(row.state, "quiet"))),
    Column("Progress", lambda row: row.share, lambda share: f"{100 * share:.0f} %", width=78),
    Column("Time left", lambda row: row.left, lambda left: "" if left is None else duration(left), number=True,
           width=70),
    Column("", lambda row: "", width=176),  # the buttons of the job
    Column("Rate", lambda row: row.rate, _rate, number=True, width=56, optional=True),
    Column("Duration", lambda row: row.took, lambda took: "–" if took is None else duration(took), number=True,
           width=84, optional=True),
    Column("Started", lambda row: row.started, clock, width=56, optional=True),
    Column("Note", lambda row: row.note, width=120, optional=True),
)  # fmt: skip
STATE, PROGRESS, BUTTONS = 1, 2, 4


class JobModel(TableModel[Row]):
    """One row for each job, in the order in which they run. rowsReplaced(): rows were added or removed."""

    rowsReplaced = Signal()

    def __init__(self, document: Document, queue: JobQueue | None = None, parent: QWidget | None = None) -> None:
        super().__init__(COLUMNS, parent, key=lambda row: row.key, about=lambda row: row.note, in_place=True)
        self._document, self._queue = document, queue
        self.replacing = False
        """Whether rows are being added or removed."""
        document.contentsChanged.connect(self._on_contents)
        if queue is not None:
            queue.changed.connect(self.refresh)
            queue.progressed.connect(self.refresh)
        self.refresh()

    def _on_contents(self, parts: frozenset[str]) -> None:
        if "jobs" in parts:
            self.refresh()

    def refresh(self) -> None:
        """Updates the rows."""
        handles = [] if self._queue is None else self._queue.handles
        ran = {} if self._queue is None else self._queue.ran
        rows = [Row.of_handle(h) for h in handles]
        rows += [
            Row.of_record(r)
            for r in self._document.contents.jobs
            if not (r.pid in ran and r.started >= ran[r.pid] - 1.0)
        ]
        before, self.replacing = [row.key for row in self.rows], True
        self.show(sorted(rows, key=lambda row: row.ordered))
        self.replacing = False
        if before != [row.key for row in self.rows]:
            self.rowsReplaced.emit()


class ProgressBar(QStyledItemDelegate):
    """Draws the progress of a job in the color of its state."""

    def paint(self, painter: QPainter, option: QStyleOptionViewItem, index: Index) -> None:
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
