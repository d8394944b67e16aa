"""The jobs of the project: a table, buttons for the selected job, and its curves, images, messages, and workers."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import Qt, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QGuiApplication, QPalette
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QSplitter, QTabWidget, QToolButton, QVBoxLayout, QWidget

from app.forms.arguments import command_line
from app.jobs.made import folder_of
from app.jobs.queue import JobHandle, JobQueue
from app.look.hint import Hint
from app.look.labels import Label
from app.look.plain_text import plain, tip
from app.look.wrapping import WrappingRow
from app.panels.imported_job_dialog import ImportedJobDialog
from app.panels.job_log import JobLog
from app.panels.job_plots import JobPlots
from app.panels.job_preview import JobPreview
from app.panels.job_table import PROGRESS, JobModel, ProgressBar, Row, duration
from app.panels.job_workers import JobWorkers
from app.panels.submaps import table
from app.state.document import Document
from app.state.reasons import TRAININGS

__all__ = ["JobModel", "JobPanel", "duration"]
_AGAIN = ("paused", "interrupted", "failed", "cancelled")
_OPEN = ("running", "queued", "paused", "interrupted")
_NO_HANDLE = "it was started in a terminal"
_ELSEWHERE = "it was ordered elsewhere; inspect it first"


class Offer(QWidget):
    """A line above the table that offers to continue the jobs that wait for the user."""

    def __init__(self, queue: JobQueue, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._queue = queue
        self._handles: list[JobHandle] = []
        self.setAutoFillBackground(True)
        self.setBackgroundRole(QPalette.ColorRole.ToolTipBase)
        self.words = Label(self)
        self.words.setWordWrap(True)
        self.go_on = QPushButton("Continue", self)
        self.go_on.clicked.connect(self._go_on)
        self.later = QPushButton("Not now", self)
        self.later.clicked.connect(self.hide)
        row = QHBoxLayout(self)
        row.setContentsMargins(10, 3, 6, 3)
        row.addWidget(self.words, 1)
        row.addWidget(self.go_on)
        row.addWidget(self.later)
        self.hide()

    def show_jobs(self, handles: Sequence[JobHandle]) -> None:
        """Offers to continue these jobs."""
        self._handles = list(handles)
        self.words.setText(waiting_words(handles))
        self.setVisible(bool(handles))

    def check(self) -> None:
        """Hides the offer if none of its jobs waits or the queue is busy."""
        self._handles = [h for h in self._handles if h in self._queue.handles and h.state not in ("running", "done")]
        if not self._handles or self._queue.busy:
            self.hide()

    def _go_on(self) -> None:
        for handle in self._handles:
            if handle.state in _AGAIN:
                self._queue.resume(handle)
        self._queue.begin_waiting()
        self.hide()


def waiting_words(handles: Sequence[JobHandle]) -> str:
    """One sentence about the jobs that wait for the user."""
    words = {"interrupted": "was interrupted", "paused": "is paused", "queued": "waits", "failed": "failed"}
    named = [f"“{plain(h.title)}” {words.get(h.state, h.state)}" for h in handles[:3]]
    more = f" and {len(handles) - 3} more wait" if len(handles) > 3 else ""
    return f"{', '.join(named)}{more}. Finished work is kept."


class JobPanel(QWidget):
    """The table of jobs and the details of the selected one.

    againWanted(JobHandle): change the settings of a job and run it again. largeWanted(JobHandle): open the training
    window of a job.
    """

    againWanted = Signal(object)
    largeWanted = Signal(object)

    def __init__(self, document: Document, queue: JobQueue | None = None, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.queue = queue or JobQueue(self)
        self.model = JobModel(document, queue, self)
        self.offer = Offer(self.queue, self)
        self.table = table(self.model, self)
        self.table.setAccessibleName("Jobs")
        self._shape_table()
        self.hint = Hint(self.table, self._missing).follow(self.table)
        self.plots, self.preview, self.log = JobPlots(self), JobPreview(self), JobLog(self)
        self.tabs = QTabWidget(self)
        self.tabs.setDocumentMode(True)
        for widget, title in ((self.plots, "Curves"), (self.preview, "Preview"), (self.log, "Messages")):
            self.tabs.addTab(widget, title)
        self.workers = JobWorkers(self)
        self._workers_tab = self.tabs.addTab(self.workers, "Workers")
        self.tabs.setTabVisible(self._workers_tab, False)
        self.tabs.currentChanged.connect(lambda _: self._refresh_shown())
        self.large = QToolButton(self)
        self.large.setText("Enlarge…")
        self.large.setAutoRaise(True)
        self.large.setToolTip(tip("Show the curves and images in a separate window, also beside those of another run"))
        self.large.clicked.connect(self._on_large)
        self.tabs.setCornerWidget(self.large)
        self._chosen = ""  # key of the row whose details are shown
        self._held = False  # the user selected it
        left = QWidget(self)
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addWidget(self.offer)
        column.addWidget(self.table, 1)
        column.addLayout(self._buttons())
        self.splitter = QSplitter(Qt.Orientation.Horizontal, self)
        self.splitter.addWidget(left)
        self.splitter.addWidget(self.tabs)
        self.splitter.setStretchFactor(0, 3)
        self.splitter.setStretchFactor(1, 2)
        self.splitter.setSizes([600, 400])
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.splitter)
        self.table.selectionModel().currentRowChanged.connect(lambda *_: self._on_chosen())
        self.table.clicked.connect(self._on_clicked)
        self.model.modelReset.connect(self._keep_choice)
        self.queue.changed.connect(self._on_changed)
        self.queue.progressed.connect(self._refresh_shown)
        self.queue.found.connect(self.offer.show_jobs)
        self._keep_choice()

    def _missing(self) -> str:
        return "" if self.model.rowCount() else "Jobs and their progress appear here.\nStart them from the Jobs menu."

    def _shape_table(self) -> None:
        self.table.setItemDelegateForColumn(PROGRESS, ProgressBar(self.table))
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(header.ResizeMode.Interactive)
        for column, width in enumerate((118, 72, 78, 70, 54, 84, 52, 40)):
            header.resizeSection(column, width)
        header.setStretchLastSection(True)
        self.table.setTextElideMode(Qt.TextElideMode.ElideRight)
        self.table.setWordWrap(False)
        self.table.setMinimumWidth(260)

    def _buttons(self) -> WrappingRow:
        row = WrappingRow()
        row.setContentsMargins(4, 3, 4, 3)
        self.pause = self._button("Pause", self._on_pause)
        self.go_on = self._button("Continue", self._on_go_on)
        self.cancel = self._button("Cancel", self._on_cancel)
        self.look = self._button("Inspect…", self._on_look)
        self.show_folder = self._button("Show folder", self._on_show_folder)
        self.again = self._button("Settings…", self._on_again)
        self.remove = self._button("Remove", self._on_remove)
        self.copy = self._button("Copy command", self._on_copy)
        left, right = (self.pause, self.go_on, self.cancel, self.look), (self.again, self.remove, self.copy)
        for button in (*left, self.show_folder, *right):
            row.addWidget(button)
        return row

    def _button(self, text: str, handler: object) -> QPushButton:
        button = QPushButton(text, self)
        button.setMinimumWidth(button.fontMetrics().horizontalAdvance(text) + 14)  # narrower than the style's own
        button.clicked.connect(handler)
        return button

    # Selected job -----------------------------------------------------------------------------------------------

    @property
    def row(self) -> Row | None:
        """The row whose details are shown."""
        return next((r for r in self.model.rows if r.key == self._chosen), None)

    @property
    def handle(self) -> JobHandle | None:
        return None if self.row is None else self.row.handle

    def choose(self, handle: JobHandle) -> None:
        """Selects the row of this job."""
        for i, row in enumerate(self.model.rows):
            if row.handle is handle:
                self.table.selectRow(i)

    def _on_clicked(self) -> None:
        self._held = True

    def _on_chosen(self) -> None:
        index = self.table.currentIndex()
        key = self.model.rows[index.row()].key if 0 <= index.row() < len(self.model.rows) else ""
        if key == self._chosen:
            return
        self._chosen = key
        handle = self.handle
        if handle is not None:
            self.queue.watch(handle)
        for part in (self.plots, self.preview, self.log, self.workers):
            part.show_job(handle)
        self._show_workers()
        self._show_buttons()

    def _keep_choice(self) -> None:
        """Restores the selection after rows changed. If the user selected none, selects the first row."""
        keys = [r.key for r in self.model.rows]
        if self._held and self._chosen in keys:
            self.table.selectRow(keys.index(self._chosen))
        elif keys:
            self._held = False
            self.table.selectRow(0)
        else:
            self._on_chosen()
        self._show_buttons()

    def _on_changed(self) -> None:
        self.offer.check()
        self._show_buttons()
        self._refresh_shown()

    def _refresh_shown(self) -> None:
        self.plots.refresh()
        self.preview.refresh()
        self.log.refresh()
        self.workers.refresh()
        self._show_workers()

    def _show_workers(self) -> None:
        """Shows the tab of workers only for jobs that run on a cluster."""
        if self.tabs.isTabVisible(self._workers_tab) != self.workers.any:
            self.tabs.setTabVisible(self._workers_tab, self.workers.any)

    def _show_buttons(self) -> None:
        row, handle = self.row, self.handle
        state = "" if row is None else row.state
        nothing = "no job is selected" if row is None else _NO_HANDLE if handle is None else ""
        asked = handle is not None and handle.wish is not None and handle.running
        reasons = {
            self.look: nothing or ("it was ordered here" if handle is None or handle.ours else ""),
            self.show_folder: nothing or ("" if handle and folder_of(handle.job) else "it wrote no folder"),
            self.pause: nothing or ("" if state in ("running", "queued") and not asked else _is(state)),
            self.go_on: nothing or self._why_not_on(state),
            self.cancel: nothing or ("" if state in ("running", "queued", "paused", "interrupted") else _is(state)),
            self.again: nothing or ("it is running" if state in ("running", "queued") else ""),
            self.remove: nothing or ("it is running" if state == "running" else ""),
            self.copy: nothing,
        }
        verb = "" if handle is None else handle.job.order.verb
        self.large.setVisible(verb in TRAININGS)
        for button, reason in reasons.items():
            button.setEnabled(not reason)
            if button in (self.look, self.show_folder):
                button.setVisible(not reason)
            button.setToolTip(tip(_TIPS[button.text()] + (f"\nUnavailable: {reason}." if reason else "")))

    def _why_not_on(self, state: str) -> str:
        if self.handle is not None and not self.handle.ours:
            return _ELSEWHERE
        if state == "queued":
            return "another job is running" if self.queue.busy else ""
        return "" if state in _AGAIN else _is(state)

    # Buttons ----------------------------------------------------------------------------------------------------

    def _on_pause(self) -> None:
        if self.handle is not None:
            self.queue.pause(self.handle)

    def _on_go_on(self) -> None:
        if self.handle is None:
            return
        if self.handle.state == "queued":
            self.queue.begin_waiting()
        else:
            self.queue.resume(self.handle)

    def _on_cancel(self) -> None:
        if self.handle is not None:
            self.queue.cancel(self.handle)

    def _on_remove(self) -> None:
        if self.handle is not None:
            self.queue.forget(self.handle)

    def _on_large(self) -> None:
        if self.handle is not None:
            self.largeWanted.emit(self.handle)

    def _on_again(self) -> None:
        if self.handle is not None:
            self.againWanted.emit(self.handle)

    def _on_look(self) -> None:
        if self.handle is not None and not self.handle.ours:
            ImportedJobDialog(self.queue, self.handle.job, self).open()

    def _on_show_folder(self) -> None:
        folder = None if self.handle is None else folder_of(self.handle.job)
        if folder is not None:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))

    def _on_copy(self) -> None:
        if self.handle is not None:
            order = self.handle.job.order
            QGuiApplication.clipboard().setText(command_line(order.verb, order.arguments))


def _is(state: str) -> str:
    return _ELSEWHERE if state == "foreign" else f"it is {state}"


_TIPS = {
    "Inspect…": "Show the exact command of a job that came with the project, to order it here or remove it",
    "Pause": "Stop at the last checkpoint and free the memory; continue at any time, also in another window",
    "Continue": "Run the job again; finished work is not repeated",
    "Cancel": "End the job; its finished results stay in the project",
    "Show folder": "Open the output folder of the job in the file manager",
    "Settings…": "Show the settings of the job, change them, and run it again",
    "Remove": "Remove the job from this list; its results stay in the project",
    "Copy command": "Copy the equivalent terminal command",
}
