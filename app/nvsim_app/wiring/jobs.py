"""The jobs of the window: each stage or evaluation with its settings, all stages in order, and the training window."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from PySide6.QtCore import QByteArray, QSettings, QTimer, Signal
from PySide6.QtGui import QImage

from nvsim.events import Preview
from nvsim.plain_text import capitalized
from nvsim.project.earlier_results import kept_results
from nvsim.project.project import Project
from nvsim.project.work import EVALUATIONS, EXPORTS, PIPELINE, SPLAT_STAGES, WORK
from nvsim_app.actions import Action
from nvsim_app.forms.fields import Settings
from nvsim_app.forms.form import CommandForm
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.look.widgets import show_and_focus
from nvsim_app.panels.jobs import JobPanel, waiting_words
from nvsim_app.panels.stages import EarlierResults, RunningJob, StageBar
from nvsim_app.panels.training_images import read_picture
from nvsim_app.panels.training_window import TrainingWindow
from nvsim_app.state.loading import ChosenFrames
from nvsim_app.state.reasons import (
    capture_or_job,
    reason_of_command,
    with_earlier_result,
    with_project_folder,
    with_training,
)
from nvsim_app.wiring.part import Dock, Part

_BESIDE_GRAPH = ("export scan", "export features", "export tasks", "export dataset")  # in the File menu
_EXPORTS = tuple(verb for verb in EXPORTS if verb not in _BESIDE_GRAPH)
_AGENTS = ("r2r train",)
_SHORTCUTS = {"train": "Ctrl+Shift+T", "map": "Ctrl+Shift+M"}


def _name(verb: str) -> str:
    return f"job_{verb.replace(' ', '_')}"


def _notice_subject(verb: str) -> str:
    """What the notices about a job of this command are about."""
    return f"job {verb}"


def _actions(verbs: Sequence[str], section: int) -> tuple[Action, ...]:
    rows = (WORK[verb] for verb in verbs)
    return tuple(
        Action("&Jobs", section, _name(row.verb), f"{row.title}…", capitalized(row.summary),
               lambda part, verb=row.verb: part.open_form(verb), _SHORTCUTS.get(row.verb, ""),
               reason_of_command(row.verb))
        for row in rows
    )  # fmt: skip


class JobsPart(Part):
    """Starts and shows jobs. formOpened(CommandForm): a form is about to be shown, and a part may add widgets to it."""

    formOpened = Signal(object)

    def docks(self) -> tuple[Dock, ...]:
        w = self.context
        self._chosen: ChosenFrames | None = None  # frames whose last image is shown in the center
        self._frame = QImage()
        self.panel = JobPanel(w.jobs)
        self.panel.againWanted.connect(self._open_again)
        w.jobs.heard.connect(self._on_heard)
        w.jobs.ended.connect(self._on_ended)
        w.jobs.found.connect(self._on_found)
        w.jobs.foundForeign.connect(self._on_foreign)
        return (
            Dock("jobs", "Jobs", self.panel, "bottom", height=224, needs=with_project_folder, workspaces=("train",)),
        )

    def restore(self, settings: QSettings) -> None:
        state = settings.value("jobs_splitter")
        if state is not None:
            self.panel.splitter.restoreState(state)
        window, w = self.context.window, self.context
        self.bar = StageBar(w.scene)
        self.status = RunningJob(w.jobs, window)
        self.status.clicked.connect(self.show_panel)
        window.statusBar().insertPermanentWidget(0, self.status)
        for offer in (window.empty, self.bar):
            offer.runWanted.connect(self.run_everything)
            offer.stageWanted.connect(self.run_stage)
            offer.settingsWanted.connect(self.open_form)
        w.document.contentsChanged.connect(self._offer_stage)
        w.jobs.changed.connect(self._offer_stage)

    def store(self, settings: QSettings) -> None:
        settings.setValue("jobs_splitter", self.panel.splitter.saveState())

    # Starting ---------------------------------------------------------------------------------------------------

    def run_stage(self, verb: str, arguments: Sequence[str] | None = None) -> JobHandle | None:
        """Queues a command on the open project with the user's settings, or with `arguments`."""
        project = self.context.document.project
        if project is None:
            return None
        row = WORK[verb]
        with self.context.notices.reporting():
            chosen = Settings(project).arguments(verb) if arguments is None else list(arguments)
            words = ["--project", str(project), *chosen, *(["--json"] if row.prints_figures else [])]
            handle = self.context.jobs.start(verb, words, project, row.title, row.heavy)
            self.context.notices.resolve(_notice_subject(verb))
            self.show_panel()
            return handle
        return None

    def run_everything(self) -> None:
        """Queues all stages in order. Stages that are up to date end at once."""
        stages = PIPELINE if self.context.document.contents.has_images else SPLAT_STAGES[1:]
        for verb in stages:
            if self.run_stage(verb) is None:
                return

    def open_form(self, verb: str, begin_with: dict[str, Any] | None = None) -> CommandForm | None:
        """Opens the form of a command. The user starts the command there."""
        project = self.context.document.project
        if project is None:
            return None
        begin = {"out": str(project.parent / OUT[verb])} if verb in OUT else {}
        form = CommandForm(
            verb,
            WORK[verb].title,
            project,
            Settings(project),
            self.context.window,
            {**begin, **(begin_with or {})},
            "Add to the queue" if self.context.jobs.busy and WORK[verb].heavy else "Start",
        )
        form.started.connect(lambda arguments: self.run_stage(verb, arguments))
        self.formOpened.emit(form)
        form.open()
        return form

    def open_earlier(self) -> EarlierResults | None:
        """Opens the list of earlier results."""
        project = self.context.document.project
        if project is None:
            return None
        with self.context.notices.reporting():
            with Project.open(project) as opened:
                kept = kept_results(opened)
            dialog = EarlierResults(kept, self.context.window)
            dialog.chosen.connect(self.restore_result)
            dialog.open()
            return dialog
        return None

    def restore_result(self, stage: str, discard: bool = False) -> JobHandle | None:
        """Queues a job that restores the earlier result of a stage, or deletes it."""
        project = self.context.document.project
        if project is None:
            return None
        words = ["--project", str(project), stage, *(["--discard"] if discard else [])]
        title = f"{'Delete' if discard else 'Restore'} the earlier result of {stage}"
        with self.context.notices.reporting():
            handle = self.context.jobs.start("restore", words, project, title)
            self.show_panel()
            return handle
        return None

    def show_panel(self) -> None:
        """Brings the panel of jobs to the front."""
        self.context.window.show_dock("jobs")

    # Following --------------------------------------------------------------------------------------------------

    def _offer_stage(self) -> None:
        """Offers the next missing stage over the view, unless a job is running or queued."""
        contents, jobs = self.context.document.contents, self.context.jobs
        missing = contents.missing
        waiting = any(h.state in ("running", "queued") for h in jobs.handles)
        verb = "" if not missing or waiting else contents.missing_verb
        self.bar.show_message(missing, verb)
        self._say_what_comes()

    def _say_what_comes(self) -> None:
        """Shows the running import in the center, if the project has no capture yet."""
        document, window = self.context.document, self.context.window
        makers = [h for h in self.context.jobs.handles if h.job.order.verb in MAKERS]
        making = next((h for h in makers if h.state in ("running", "queued")), None)
        missing = document.contents.missing
        if not missing or document.contents.capture is not None or document.project is None:
            return
        if making is None:
            window.empty.show_message(missing, document.contents.missing_verb)
        elif (chosen := document.contents.chosen) is not None:
            sentence = f"{making.title} …\n{chosen.count:,} images chosen so far"
            if chosen != self._chosen:
                self._chosen, self._frame = chosen, read_picture(chosen.last)
            window.empty.show_message(sentence, image=self._frame)
        else:
            window.empty.show_message(f"{making.title} …")

    def _open_again(self, handle: JobHandle) -> None:
        if handle.job.order.verb in (*PIPELINE, *EVALUATIONS, *EXPORTS, *_AGENTS):
            self.open_form(handle.job.order.verb)
        else:
            self.context.notices.info(f"“{handle.title}” has no settings to change; Continue runs it again.")

    def _on_heard(self, handle: JobHandle, event: object) -> None:
        """Draws the new state of a model in training."""
        scene = self.context.scene
        if isinstance(event, Preview) and handle.running and not scene.drawing:
            scene.set_channel(scene.feed.channel)

    def _on_ended(self, handle: JobHandle) -> None:
        notices, state, about = self.context.notices, handle.state, _notice_subject(handle.job.order.verb)
        if state == "done":
            default = "the figures are in Results" if handle.job.order.verb in EVALUATIONS else "done"
            notices.info(f"{handle.title}: {handle.message or default}", about=about)
        elif state == "failed":
            notices.error(f"{handle.title} failed: {handle.message or 'see its messages'}", about=about)
        elif state == "interrupted":
            words = " You can continue it in the Jobs panel." if handle.job.resumable else ""
            notices.warning(f"{handle.title} was interrupted. {handle.message}{words}", about=about)
            self.panel.offer.show_jobs([handle] if handle.job.resumable else [])
        waiting = [h for h in self.context.jobs.handles if h.state == "queued" and h.job.order.heavy]
        if state in ("failed", "interrupted") and waiting and not self.context.jobs.busy:
            held = [handle, *waiting] if state == "interrupted" and handle.job.resumable else waiting
            self.panel.offer.show_jobs(held)
        self.context.window.refreshWanted.emit()

    def _on_found(self, handles: list[JobHandle]) -> None:
        self.context.notices.warning(f"{waiting_words(handles)} You can continue in the Jobs panel.")
        QTimer.singleShot(0, self.panel, self.show_panel)  # after the panels of the opened project are laid out

    def _on_foreign(self, handles: list[JobHandle]) -> None:
        one = len(handles) == 1
        self.context.notices.warning(
            f"{len(handles)} job{' was' if one else 's were'} ordered elsewhere and came with this project; "
            f"{'it does' if one else 'they do'} not run. The Jobs panel shows what {'it' if one else 'they'} would do."
        )
        QTimer.singleShot(0, self.panel, self.show_panel)

    ACTIONS = (
        Action("&Jobs", 0, "run_everything", "&Run everything",
               f"Queue every stage with its settings: {', '.join(PIPELINE)}; stages that are up to date end at once",
               run_everything, "Ctrl+R", capture_or_job, icon="run", toolbar=True),
        *_actions(PIPELINE, 1),
        *_actions(EVALUATIONS, 2),
        Action("&Jobs", 4, "earlier_results", "Ea&rlier results…",
               "Restore or delete the result of a stage before its last run", open_earlier,
               enabled=with_earlier_result),
        *_actions(_EXPORTS, 3),
        *_actions(_AGENTS, 5),
    )  # fmt: skip


MAKERS = ("import", "demo", "run")
"""Commands that create the capture of a project."""
OUT = {
    "export r2r": "connectivity",
    "export scan": "scans",
    "export splats": "splats",
    "export tasks": "tasks",
    "export dataset": "dataset",
    "r2r train": "agent",
}
"""Default output folders of commands. They are beside the project, not in the working directory of the window."""


_PLACE, _SPLIT, _SMOOTHING = "training/geometry", "training/splitter", "training/smoothing"


class TrainingPart(Part):
    """Opens the training window."""

    window: TrainingWindow | None = None

    def restore(self, settings: QSettings) -> None:
        self.context.part(JobsPart).panel.largeWanted.connect(self._open_for)

    def store(self, settings: QSettings) -> None:
        if self.window is not None:
            self.window.close()

    def open_window(self) -> TrainingWindow:
        """Shows the window with the job that is selected in the Jobs panel. There is only one window."""
        if self.window is None:
            self.window = TrainingWindow(self.context.jobs, self.context.window)
            self._place(self.window)
            self.window.finished.connect(self._on_finished)
        self.window.show_run(self.context.part(JobsPart).panel.handle)
        show_and_focus(self.window)
        return self.window

    def _open_for(self, handle: JobHandle) -> None:
        self.open_window().show_run(handle)

    def _place(self, window: TrainingWindow) -> None:
        settings = self.context.settings
        place, split, smoothing = (settings.value(name) for name in (_PLACE, _SPLIT, _SMOOTHING))
        if isinstance(place, QByteArray):
            window.restoreGeometry(place)
        if isinstance(split, QByteArray):
            window.splitter.restoreState(split)
        if str(smoothing).isdecimal():
            window.smoothing.setValue(int(str(smoothing)))

    def _on_finished(self) -> None:
        """Stores the place and the settings of the closed window."""
        window, self.window = self.window, None
        if window is not None:
            settings = self.context.settings
            settings.setValue(_PLACE, window.saveGeometry())
            settings.setValue(_SPLIT, window.splitter.saveState())
            settings.setValue(_SMOOTHING, window.smoothing.value())

    ACTIONS = (
        Action("&Jobs", 4, "training", "Training &window…",
               "Compare the images of training steps with a held-out photo, and the curves of two runs", open_window,
               "Ctrl+Shift+J", with_training),
    )  # fmt: skip
