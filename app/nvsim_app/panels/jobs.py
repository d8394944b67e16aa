"""The jobs of the project in the order in which they run, each with its buttons; and the curves, images, messages, and
workers of the running or selected job."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from PySide6.QtCore import QEvent, QObject, Qt, QUrl, Signal
from PySide6.QtGui import QAction, QDesktopServices, QGuiApplication, QPalette
from PySide6.QtWidgets import QHBoxLayout, QMenu, QSplitter, QTabWidget, QToolButton, QWidget

from nvsim_app.forms.fields import command_line
from nvsim_app.jobs.history import folder_of
from nvsim_app.jobs.queue import AGAIN, ELSEWHERE, JobHandle, JobQueue
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Hint, Label
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.table import table
from nvsim_app.look.widgets import push_button, tool_button
from nvsim_app.panels.job_plots import JobPlots
from nvsim_app.panels.job_table import (
    BUTTONS,
    PROGRESS,
    TITLE,
    TITLE_WIDTHS,
    ImportedJobDialog,
    JobModel,
    JobWorkers,
    ProgressBar,
    duration,
)
from nvsim_app.panels.log import JobLog
from nvsim_app.panels.training_images import JobPreview
from nvsim_app.state.reasons import TRAININGS

__all__ = ["JobModel", "JobPanel", "duration"]
GAP = 8  # between the title of a job and its state, pixels


@dataclass(frozen=True)
class JobCommand:
    """A command for one job.

    run      the command
    reason   why it is unavailable for a job, "" if it is available
    in_row   whether it has a button in the row while it is available; the others are in a menu
    """

    text: str
    tip: str
    run: Callable[[JobPanel, JobHandle], object]
    reason: Callable[[JobPanel, JobHandle], str] = lambda panel, job: ""
    in_row: bool = False


class WaitingJobsBar(QWidget):
    """A line above the table that offers to continue the jobs that wait for the user."""

    def __init__(self, queue: JobQueue, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._queue = queue
        self._handles: list[JobHandle] = []
        self.setAutoFillBackground(True)
        self.setBackgroundRole(QPalette.ColorRole.ToolTipBase)
        self.words = Label(self, wordWrap=True)
        self.go_on = push_button("Continue", self, self._go_on)
        self.later = push_button("Not now", self, self.hide)
        hbox((self.words, 1), self.go_on, self.later, on=self, margins=(8, 4, 8, 4))
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
        stopped = [handle for handle in self._handles if handle.state in AGAIN]
        if stopped:
            self._queue.resume(*stopped)
        else:
            self._queue.begin_waiting()
        self.hide()


def waiting_words(handles: Sequence[JobHandle]) -> str:
    """One sentence about the jobs that wait for the user."""
    words = {"interrupted": "was interrupted", "paused": "is paused", "queued": "waits", "failed": "failed"}
    named = [f"“{plain(h.title)}” {words.get(h.state, h.state)}" for h in handles[:3]]
    more = f" and {len(handles) - 3} more wait" if len(handles) > 3 else ""
    return f"{', '.join(named)}{more}. Finished work is kept."


class JobButtons(QWidget):
    """The buttons in the row of one job. They act on the job with this number, whichever row is selected.

    done(name): a command of COMMANDS was chosen.
    """

    done = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        row = QHBoxLayout(self)
        row.setContentsMargins(4, 0, 4, 0)
        row.setSpacing(4)
        self.commands: dict[str, QAction] = {}
        self.buttons: dict[str, QToolButton] = {}
        self.more = QToolButton(self)
        self.more.setText("⋯")  # raised like the other buttons: its text alone has no contrast on a selected row
        self.more.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self.more.setToolTip("Other commands for this job")
        self.more.setAccessibleName("Other commands")
        menu = QMenu(self.more, toolTipsVisible=True)
        self.more.setMenu(menu)
        for name, command in COMMANDS.items():
            action = self.commands[name] = QAction(command.text, self)
            action.triggered.connect(lambda _, name=name: self.done.emit(name))
            if not command.in_row:
                menu.addAction(action)
                continue
            button = self.buttons[name] = QToolButton(self)
            button.setDefaultAction(action)
            row.addWidget(button)
        row.addWidget(self.more)
        row.addStretch(1)

    def show_reasons(self, reasons: Mapping[str, str], in_place: bool) -> None:
        """Enables the commands. `reasons` says for each one why it is unavailable, "" if it is available. in_place:
        whether unavailable buttons stay visible, so that none moves to the place of one that was just clicked."""
        for name, action in self.commands.items():
            reason = reasons[name]
            action.setEnabled(not reason)
            action.setToolTip(tooltip_text(COMMANDS[name].tip + (f"\nUnavailable: {reason}." if reason else "")))
        for name, button in self.buttons.items():
            button.setVisible(not reasons[name] or in_place and not button.isHidden())

    def take_focus(self, wanted: bool) -> None:
        """Lets Tab reach the buttons; only those of the selected row, so that Tab leaves the table soon."""
        policy = Qt.FocusPolicy.TabFocus if wanted else Qt.FocusPolicy.NoFocus
        for button in (*self.buttons.values(), self.more):
            button.setFocusPolicy(policy)


class JobPanel(QWidget):
    """The table of jobs and the details of the selected one.

    againWanted(JobHandle): change the settings of a job and run it again. largeWanted(JobHandle): open the training
    window of a job.
    """

    againWanted = Signal(object)
    largeWanted = Signal(object)

    def __init__(self, queue: JobQueue) -> None:
        super().__init__()
        self.queue = queue
        self.model = JobModel(queue, self)
        self.offer = WaitingJobsBar(self.queue, self)
        self.table = table(self.model, self, "Jobs")
        self._shape_table()
        self.hint = Hint(self.table, self._missing).refresh_with(self.table)
        self.plots, self.preview, self.log = JobPlots(self), JobPreview(self), JobLog(self)
        self.tabs = QTabWidget(self, documentMode=True)
        for widget, title in ((self.plots, "Curves"), (self.preview, "Preview"), (self.log, "Messages")):
            self.tabs.addTab(widget, title)
        self.workers = JobWorkers(self)
        self._workers_tab = self.tabs.addTab(self.workers, "Workers")
        self.tabs.setTabVisible(self._workers_tab, False)
        self.tabs.currentChanged.connect(lambda _: self._refresh_shown())
        self.large = tool_button("Enlarge…", self, self._on_large, COMMANDS["enlarge"].tip, autoRaise=True)
        self.tabs.setCornerWidget(self.large)
        self._chosen: JobHandle | None = None  # whose details are shown
        self._held = False  # the user selected it; otherwise the running job is shown
        self._following = False  # the panel itself changes the selection
        self.buttons_of: dict[JobHandle, JobButtons] = {}
        """The buttons in the row of each job."""
        left = QWidget(self)
        vbox(self.offer, (self.table, 1), on=left, margins=0, spacing=0)
        self.splitter = QSplitter(Qt.Orientation.Horizontal, self)
        self.splitter.addWidget(left)
        self.splitter.addWidget(self.tabs)
        self.splitter.setStretchFactor(0, 3)
        self.splitter.setStretchFactor(1, 2)
        self.splitter.setSizes([600, 400])
        self.tabs.installEventFilter(self)
        vbox(self.splitter, on=self, margins=0)
        self.table.selectionModel().currentRowChanged.connect(lambda *_: self._on_chosen())
        self.model.rowsReplaced.connect(self._on_rows)
        self.queue.changed.connect(self._on_changed)
        self.queue.progressed.connect(self._refresh_shown)
        self.queue.found.connect(self.offer.show_jobs)
        self._on_rows()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self.tabs and event.type() == QEvent.Type.Resize:
            self._fit_tabs()
        return super().eventFilter(watched, event)

    def _fit_tabs(self) -> None:
        """Makes room for all tabs. Beside them is the button if there is room; it is also in the menu of a row."""
        tabs = self.tabs.tabBar().sizeHint().width()
        self.tabs.setMinimumWidth(tabs)
        trains = self.handle is not None and self.handle.job.order.verb in TRAININGS
        self.large.setVisible(trains and self.tabs.width() >= tabs + self.large.sizeHint().width())

    def _missing(self) -> str:
        return "" if self.model.rowCount() else "Jobs and their progress appear here.\nStart them from the Jobs menu."

    def _shape_table(self) -> None:
        self.table.setItemDelegateForColumn(PROGRESS, ProgressBar(self.table))
        self.table.verticalHeader().setDefaultSectionSize(28)
        self.table.setTextElideMode(Qt.TextElideMode.ElideRight)
        self.table.setWordWrap(False)
        self.table.setMinimumWidth(260)

    # Selected job -----------------------------------------------------------------------------------------------

    @property
    def handle(self) -> JobHandle | None:
        """The job whose details are shown."""
        return self._chosen if self._chosen in [row.handle for row in self.model.rows] else None

    def choose(self, handle: JobHandle) -> None:
        """Selects the row of this job, until the user selects another one."""
        self._select(handle)
        self._held = True

    def _select(self, key: JobHandle) -> None:
        self._following = True
        keys = [row.handle for row in self.model.rows]
        if key in keys:
            self.table.selectRow(keys.index(key))
            self.table.scrollTo(self.model.index(keys.index(key), 0))
            self._on_chosen()  # the current row may be the right one already, after others were removed
        self._following = False

    def _on_chosen(self) -> None:
        if self.model.replacing:
            return  # Qt selects another row while the selected one is removed
        place = self.table.currentIndex().row()
        row = self.model.row(place) if 0 <= place < self.model.rowCount() else None
        if not self._following:
            self._held = row is not None and row.state != "running"
        key = None if row is None else row.handle
        if key == self._chosen:
            return
        self._chosen = key
        handle = self.handle
        if handle is not None:
            self.queue.read_events_of(handle)
        for part in (self.plots, self.preview, self.log, self.workers):
            part.show_job(handle)
        self._show_workers()
        self._show_buttons()

    def _on_rows(self) -> None:
        """Makes the buttons of new rows. Other rows keep theirs, so that a pressed button stays under the mouse."""
        before, self.buttons_of = self.buttons_of, {}
        for place, row in enumerate(self.model.rows):
            buttons = before.get(row.handle)
            if buttons is None:
                buttons = JobButtons(self.table)
                buttons.done.connect(partial(self._do, row.handle.number))
                self.table.setIndexWidget(self.model.index(place, BUTTONS), buttons)
            self.buttons_of[row.handle] = buttons
        least, most = TITLE_WIDTHS
        self.table.set_widgets_width(TITLE, min(max(self.table.sizeHintForColumn(TITLE) + GAP, least), most))
        self._select_running()
        self._show_buttons()

    def _select_running(self) -> None:
        """Selects the running job, unless the user selected another one. Without a running job, the selection stays."""
        rows = self.model.rows
        keys = [row.handle for row in rows]
        self._held = self._held and self._chosen in keys
        running = next((row.handle for row in rows if row.state == "running"), None)
        if not self._held and running is not None:
            self._select(running)
        elif self._chosen is not None and self._chosen in keys:
            self._select(self._chosen)
        elif keys:
            self._select(keys[-1])
        else:
            self._on_chosen()

    def _on_changed(self) -> None:
        self.offer.check()
        self._select_running()
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
        if self.tabs.isTabVisible(self._workers_tab) != self.workers.has_workers:
            self.tabs.setTabVisible(self._workers_tab, self.workers.has_workers)
            self._fit_tabs()

    def _show_buttons(self) -> None:
        self._fit_tabs()
        for key, buttons in self.buttons_of.items():
            reasons = {name: command.reason(self, key) for name, command in COMMANDS.items()}
            buttons.show_reasons(reasons, in_place=key.running and key.wish is not None)
            buttons.take_focus(key == self._chosen)
        widths = [buttons.sizeHint().width() for buttons in self.buttons_of.values()]
        self.table.set_widgets_width(BUTTONS, max(widths, default=0))

    def _do(self, number: int, name: str) -> None:
        """Runs a command of COMMANDS on the job with this number."""
        handle = self.queue.handle(number)
        if handle is not None:
            COMMANDS[name].run(self, handle)

    def _on_large(self) -> None:
        if self.handle is not None:
            self.largeWanted.emit(self.handle)


def _why_not(job: JobHandle, *states: str) -> str:
    """The state of a job as the reason why a command is unavailable, "" if it is one of these states."""
    return "" if job.state in states else ELSEWHERE if job.state == "foreign" else f"it is {job.state}"


def _show_folder(job: JobHandle) -> None:
    if (folder := folder_of(job.job)) is not None:
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))


COMMANDS = {
    "pause": JobCommand(
        "Pause", "Stop at the last checkpoint and free the memory; continue at any time, also in another window",
        lambda panel, job: panel.queue.pause(job),
        lambda _, job: _why_not(job, *(() if job.wish and job.running else ("running", "queued"))), in_row=True),
    "resume": JobCommand(
        "Continue", "Run the job again; finished work is not repeated",
        lambda panel, job: panel.queue.resume(job), lambda panel, job: panel.queue.why_not_resume(job), in_row=True),
    "cancel": JobCommand(
        "Cancel", "End the job; its finished results stay in the project",
        lambda panel, job: panel.queue.cancel(job),
        lambda _, job: _why_not(job, "running", "queued", "paused", "interrupted"), in_row=True),
    "inspect": JobCommand(
        "Inspect…", "Show the exact command of a job that came with the project, to order it here or remove it",
        lambda panel, job: ImportedJobDialog(panel.queue, job.job, panel).open(),
        lambda _, job: "it was ordered here" if job.is_own else "", in_row=True),
    "enlarge": JobCommand(
        "Enlarge…", "Show the curves and images in a separate window, also beside those of another run",
        lambda panel, job: panel.largeWanted.emit(job),
        lambda _, job: "" if job.job.order.verb in TRAININGS else "it trains no submap"),
    "settings": JobCommand(
        "Settings…", "Show the settings of the job, change them, and run it again",
        lambda panel, job: panel.againWanted.emit(job),
        lambda _, job: "it is running" if job.state in ("running", "queued") else ""),
    "folder": JobCommand(
        "Show folder", "Open the output folder of the job in the file manager",
        lambda _, job: _show_folder(job), lambda _, job: "" if folder_of(job.job) else "it wrote no folder"),
    "copy": JobCommand("Copy command", "Copy the equivalent terminal command",
        lambda _, job: QGuiApplication.clipboard().setText(command_line(job.job.order.verb, job.job.order.arguments))),
    "remove": JobCommand(
        "Remove", "Remove the job from this list; its results stay in the project",
        lambda panel, job: panel.queue.remove(job),
        lambda _, job: "it is running" if job.state == "running" else ""),
}  # fmt: skip
"""Name -> command."""
