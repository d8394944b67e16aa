"""The table of jobs, the workers of a job on a cluster, and the dialog of a job that was ordered elsewhere."""

from __future__ import annotations

import time
from dataclasses import dataclass

from PySide6.QtCore import QRect, Qt, Signal
from PySide6.QtGui import QColor, QFontDatabase, QPainter
from PySide6.QtWidgets import (
    QDialogButtonBox,
    QPlainTextEdit,
    QPushButton,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QWidget,
)

from nvsim.errors import InputError
from nvsim.project.jobs.files import State
from nvsim.project.jobs.joblist import Job
from nvsim_app.forms.fields import command_line
from nvsim_app.jobs.queue import JobHandle, JobQueue
from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import InkLabel, Label
from nvsim_app.look.table import Column, Index, TableModel, table
from nvsim_app.look.widgets import Dialog, DialogButtons, named

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


def time_of_day(at: float | None) -> str:
    """For example "14:05", with the date if it is not today."""
    if not at:
        return "–"
    then, now = time.localtime(at), time.localtime()
    return time.strftime("%H:%M" if then[:3] == now[:3] else "%d %b %H:%M", then)


def _day_or_time(at: float | None) -> str:
    """For example "14:05", or "28 Nov" if it is not today."""
    return time_of_day(at).rpartition(" ")[0] or time_of_day(at)


@dataclass(frozen=True)
class JobRow:
    """One row of the table. handle: its key, which stays the same while the project is open."""

    handle: JobHandle
    title: str
    state: State
    share: float
    rate: float | None
    left: float | None
    started: float | None
    took: float | None
    note: str

    @staticmethod
    def of(handle: JobHandle) -> JobRow:
        running, status, history = handle.running, handle.job.status, handle.history
        share = 1.0 if handle.state == "done" else 0.0 if handle.state == "foreign" else history.share
        return JobRow(
            handle,
            handle.title,
            handle.state,
            share,
            history.rate if running else None,
            history.seconds_left if running else None,
            status.started or (handle.job.order.ordered if handle.state in ("queued", "foreign") else None),
            handle.work_seconds if handle.work_seconds else None,
            handle.message,
        )


def _rate(rate: float | None) -> str:
    return "" if rate is None else f"{rate:.{1 if rate < 100 else 0}f} /s"


TITLE_WIDTHS = 118, 200  # least and greatest width of the titles of jobs, pixels
COLUMNS: tuple[Column[JobRow], ...] = (
    Column("Job", lambda row: row.title, width=TITLE_WIDTHS[0]),
    Column("State", lambda row: row.state, lambda state: STATE_WORDS.get(state, state), width=84, optional=True,
           ink=lambda row: colors.text(_STATE_TEXTS.get(row.state, "quiet"))),
    Column("Progress", lambda row: row.share, lambda share: f"{100 * share:.0f} %", width=78),
    Column("", lambda row: "", width=96),  # the buttons of the job, before the columns that come and go
    Column("Time left", lambda row: row.left, lambda left: "" if left is None else duration(left), number=True,
           width=84, optional=True),
    Column("Rate", lambda row: row.rate, _rate, number=True, width=56, optional=True),
    Column("Duration", lambda row: row.took, lambda took: "–" if took is None else duration(took), number=True,
           width=84, optional=True),
    Column("Started", lambda row: row.started, _day_or_time, width=56, optional=True,
           about=lambda row: time_of_day(row.started)),
    Column("Note", lambda row: row.note, width=120, optional=True),
)  # fmt: skip
TITLE, STATE, PROGRESS, BUTTONS = range(4)


class JobModel(TableModel[JobRow]):
    """One row for each job, in the order in which they run. rowsReplaced(): rows were added or removed."""

    rowsReplaced = Signal()

    def __init__(self, queue: JobQueue, parent: QWidget | None = None) -> None:
        super().__init__(COLUMNS, parent, key=lambda row: row.handle, about=lambda row: row.note, in_place=True)
        self._queue = queue
        self.replacing = False
        """Whether rows are being added or removed."""
        queue.changed.connect(self.refresh)
        queue.progressed.connect(self.refresh)
        self.refresh()

    def refresh(self) -> None:
        """Updates the rows."""
        before, self.replacing = [row.handle for row in self.rows], True
        self.show([JobRow.of(handle) for handle in sorted(self._queue.handles, key=lambda h: h.job.order.ordered)])
        self.replacing = False
        if before != [row.handle for row in self.rows]:
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


Worker = tuple[str, str, str, str]
"""Name, work, state, and time of the last event."""
_COLORS = {"works": "running", "lost": "blocked"}
WORKER_COLUMNS: tuple[Column[Worker], ...] = (
    Column("Worker", lambda row: row[0]),
    Column("Works on", lambda row: row[1]),
    Column("State", lambda row: row[2], ink=lambda row: colors.text(_COLORS.get(row[2], "quiet"))),
    Column("Since", lambda row: row[3]),
)
_WORDS = {"works": "works", "ended": "idle", "lost": "lost"}


class JobWorkers(QWidget):
    """The table of the selected job's workers, working ones first."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self.model: TableModel[Worker] = TableModel(
            WORKER_COLUMNS, self, about=lambda row: f"{row[0]}: {row[1]}, {row[2]}"
        )
        self.table = table(self.model, self, "Workers")
        vbox(self.table, on=self, margins=0)

    def show_job(self, handle: JobHandle | None) -> None:
        """Shows the workers of this job."""
        self._handle = handle
        self.refresh()

    @property
    def has_workers(self) -> bool:
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
            rows.append((worker.name, worker.words if state in ("works", "lost") else "–", state, time_of_day(at)))
        self.model.show(rows)


_MOST = 20_000  # characters of a command that are shown


class ImportedJobDialog(Dialog):
    """Shows the stored order of a job. Exactly this order can be added to the queue."""

    def __init__(self, queue: JobQueue, job: Job, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("A job that was ordered elsewhere")
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self._queue, self._job = queue, job
        about = self._label(
            "This job came with the project and was not ordered on this machine. If you order it here, it runs:"
        )
        command = command_line(job.order.verb, job.order.arguments)
        self.command = named(QPlainTextEdit(command[:_MOST], self, readOnly=True), "Command")
        self.command.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        reason = queue.why_not_order_again(job)
        if len(command) > _MOST:
            reason = "Its command is too long to be shown."
        self.problem = InkLabel("blocked", self)
        self.problem.setWordWrap(True)
        self.problem.setText(reason)
        self.problem.setVisible(bool(reason))
        buttons = DialogButtons(self)
        self.order = named(QPushButton("Order here", self), tip=reason or "Add the job to the queue as your own")
        self.order.setAutoDefault(False)
        self.order.setEnabled(not reason)
        self.remove = QPushButton("Remove", self)
        self.remove.setAutoDefault(False)
        buttons.addButton(self.order, QDialogButtonBox.ButtonRole.AcceptRole)
        buttons.addButton(self.remove, QDialogButtonBox.ButtonRole.DestructiveRole)
        buttons.addButton(QDialogButtonBox.StandardButton.Close).setDefault(True)
        self.order.clicked.connect(self._on_order)
        self.remove.clicked.connect(self._on_remove)
        buttons.rejected.connect(self.reject)
        vbox(about, self.command, self.problem, buttons, on=self)
        self.resize(620, 260)

    def _label(self, text: str) -> Label:
        return Label(text, self, wordWrap=True)

    def _on_order(self) -> None:
        try:
            self._queue.order_again(self._job)
        except InputError as error:
            self.problem.setText(str(error))
            self.problem.show()
            self.order.setEnabled(False)
            return
        self.accept()

    def _on_remove(self) -> None:
        handle = self._queue.handle(self._job.number)
        if handle is not None:
            self._queue.remove(handle)
        self.accept()
