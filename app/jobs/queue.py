"""The queue of jobs of the open project, as the window sees it: looks into the job folders a few times a second, and
never waits for anything.

The jobs run on their own. Closing the window leaves them at work, a window that starts later sees them as they are.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from app.jobs.history import JobReport
from nvsim.cli.orders import check_order
from nvsim.cli.worker import start_worker
from nvsim.errors import InputError
from nvsim.files.nofollow import is_folder
from nvsim.project.job_events import EventFile
from nvsim.project.joblist import Job, JobList, State, Wish
from nvsim.project.layout import Layout

HASTY, LIVELY, CALM = 60, 250, 1000  # milliseconds between two looks: events wait, a job runs, none does
BYTES_A_LOOK = 48 << 10  # of events; some 3 ms of parsing
PATIENCE = 15.0  # seconds until a job that was asked to end is killed
STOPPED: tuple[State, ...] = ("paused", "cancelled")  # by the user, on the way
ORDERED_ELSEWHERE = "It came with the project and was not ordered here; it is not run unless you order it anew."


class JobHandle(QObject):
    """One job as last seen: `job`, and the `history` of its events."""

    def __init__(self, jobs: JobList, job: Job, parent: QObject) -> None:
        super().__init__(parent)
        self._jobs = jobs
        self.job = job
        self.history = JobReport()
        self.wish: Wish | None = None
        self.asked = 0.0
        self._file = EventFile(job.events)

    @property
    def number(self) -> int:
        return self.job.number

    @property
    def title(self) -> str:
        return self.job.order.title

    @property
    def state(self) -> State:
        return self.job.status.state

    @property
    def running(self) -> bool:
        return self.state == "running"

    @property
    def ours(self) -> bool:
        """Whether this user ordered it on this machine; what others did is never run unasked."""
        return self.job.ours

    def picture(self, path: str) -> Path | None:
        """Where an image lies that the job told of: among the images of the project and nowhere else."""
        folder = Layout(self._jobs.root).pictures
        return folder / Path(path).name if "\0" not in path and is_folder(folder) else None

    @property
    def message(self) -> str:
        """What went wrong and what to do, what it is doing, or where it stopped."""
        status, progress = self.job.status, self.history.progress
        if self.state == "foreign":
            return ORDERED_ELSEWHERE
        if self.state in ("failed", "interrupted"):
            return status.message or self.history.failure
        if self.state == "running":
            if self.wish is not None:
                return "Pausing at the last checkpoint…" if self.wish == "pause" else "Ending…"
            if progress is None or progress.done == 0:
                lines = self.history.lines
                return lines[-1].text if lines and lines[-1].text != "Started." else "Starting…"
            return f"{progress.stage}: {progress.detail}".rstrip(": ")
        if self.state in STOPPED:
            return status.message or (
                f"Stopped at {self._place}" if progress is not None else "Stopped before it began"
            )
        return status.message if self.state == "done" else ""

    @property
    def _place(self) -> str:
        """How far the stage in hand is."""
        progress = self.history.progress
        assert progress is not None  # asked before
        return f"{100 * self.history.share:.0f} % of {progress.stage}: {progress.detail}".rstrip(": ")

    @property
    def worked(self) -> float:
        """Seconds of work, pauses left out."""
        status = self.job.status
        now = time.time() - status.started if self.running and status.started else 0.0
        return status.worked + now

    def read_events(self) -> list[object]:
        """What came since the last call, heard by the history."""
        events = self._file.read(BYTES_A_LOOK)
        for at, event in events:
            self.history.hear(at, event)
        return [event for _, event in events]

    @property
    def behind(self) -> bool:
        """Whether events wait to be read."""
        return self._file.behind


class JobQueue(QObject):
    """changed() when a job came, went, or stands otherwise; progressed() at most a few times a second while one tells
    of its work; heard(JobHandle, Event) for each event that arrives, those of the past included; ended(JobHandle) when
    a job that this window saw running or waiting does no longer; found(list of JobHandle) once for a project, with the
    jobs that wait for the user; foundForeign(list of JobHandle) likewise, with those that somebody else ordered."""

    changed = Signal()
    progressed = Signal()
    heard = Signal(object, object)
    ended = Signal(object)
    found = Signal(object)
    foundForeign = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._jobs: JobList | None = None
        self.handles: list[JobHandle] = []  # in the order they were ordered
        self._watched: set[int] = set()
        self.ran: dict[int, float] = {}  # see JobList.ran
        self.threads = 0  # that a job may use, 0 for all cores
        self._timer = QTimer(self, interval=CALM)
        self._timer.timeout.connect(self._look)

    # The project ------------------------------------------------------------------------------------------------

    def follow(self, project: Path | None) -> None:
        """Shows the jobs of that project from now on."""
        root = None if project is None else Path(project).absolute()
        if root == self.project:
            return
        for handle in self.handles:
            handle.deleteLater()
        self.handles = []
        self._watched.clear()
        self._jobs = None if root is None else JobList(root)
        self._timer.stop()
        if root is not None:
            self._timer.start(CALM)
            self._look()
            waiting = [h for h in self.handles if h.state in ("interrupted", "paused", "queued")]
            if waiting and not self.running:
                self.found.emit(waiting)
            foreign = [h for h in self.handles if h.state == "foreign"]
            if foreign:
                self.foundForeign.emit(foreign)
        self.changed.emit()

    @property
    def project(self) -> Path | None:
        return None if self._jobs is None else self._jobs.root

    def stop(self) -> None:
        """Looks no more; the jobs go on."""
        self._timer.stop()

    def watch(self, handle: JobHandle) -> None:
        """Reads what that job told although it has ended."""
        self._watched.add(handle.number)
        if handle.behind:
            self._timer.setInterval(HASTY)

    # Jobs -------------------------------------------------------------------------------------------------------

    @property
    def running(self) -> list[JobHandle]:
        return [h for h in self.handles if h.running]

    @property
    def busy(self) -> bool:
        """Whether a heavy job runs."""
        return any(h.job.order.heavy for h in self.running)

    def handle(self, number: int) -> JobHandle | None:
        return next((h for h in self.handles if h.number == number), None)

    def start(self, verb: str, arguments: Sequence[str], project: Path, title: str, heavy: bool = True) -> JobHandle:
        """Runs `nvsim VERB ARGUMENTS` for `project`, now, or when the heavy job before it has ended. Light jobs start
        at once. Raises InputError when the project's folder cannot be written."""
        jobs = self._jobs if self._jobs is not None and self.project == Path(project).absolute() else JobList(project)
        job = jobs.add(verb, arguments, title, heavy)
        self._begin(jobs, None if heavy else job.number)
        if jobs is not self._jobs:
            return JobHandle(jobs, job, self)
        self._look()
        made = self.handle(job.number)
        assert made is not None  # it was looked for a moment after it was made
        return made

    def pause(self, handle: JobHandle) -> None:
        """Ends it at its last checkpoint; it goes on with `resume`, whenever that is."""
        self._ask(handle, "pause")

    def cancel(self, handle: JobHandle) -> None:
        """Ends it. What it finished stays; started again it goes on from there."""
        self._ask(handle, "cancel")

    def resume(self, handle: JobHandle) -> None:
        """Queues a job that was paused, interrupted, cancelled or has failed once more; never one that somebody else
        ordered."""
        if self._jobs is None or not handle.ours:
            return
        self._jobs.again(handle.number)
        self._begin(self._jobs, None if handle.job.order.heavy else handle.number)
        self._look()

    def why_not_anew(self, job: Job) -> str:
        """Why what somebody else ordered cannot be ordered here as it is, "" when it can."""
        if self._jobs is None:
            return "no project is open"
        try:
            check_order(self._jobs.root, job.order.verb, job.order.arguments, confined=True)
        except InputError as error:
            return str(error)
        return ""

    def order_anew(self, seen: Job) -> None:
        """Orders here what somebody else ordered, exactly as the user has `seen` it. Raises InputError where it may not
        be ordered, or was changed meanwhile."""
        if self._jobs is None:
            return
        check_order(self._jobs.root, seen.order.verb, seen.order.arguments, confined=True)
        self._jobs.order_anew(seen)
        self._begin(self._jobs, None if seen.order.heavy else seen.number)
        self._look()

    def begin_waiting(self) -> None:
        """Starts what waits in the queue, if nothing runs."""
        if self._jobs is not None and not self.busy:
            self._begin(self._jobs, None)

    def forget(self, handle: JobHandle) -> None:
        """Takes a job that does not run off the list."""
        if self._jobs is not None and not handle.running:
            with contextlib.suppress(InputError):  # it is gone already
                self._jobs.forget(handle.number)
            self._look()

    def _ask(self, handle: JobHandle, wish: Wish) -> None:
        if self._jobs is None:
            return
        with contextlib.suppress(InputError):  # it is gone already
            self._jobs.ask(handle.number, wish)
        if handle.running:
            handle.wish, handle.asked = wish, time.monotonic()
        self._look()
        if wish == "cancel":
            self.changed.emit()

    def _begin(self, jobs: JobList, number: int | None) -> None:
        start_worker(jobs.root, number, self.threads)
        self._timer.setInterval(LIVELY)

    # Looking ----------------------------------------------------------------------------------------------------

    def _look(self) -> None:
        """Brings everything up to date; some milliseconds at most."""
        if self._jobs is None:
            return
        jobs = self._jobs.jobs()
        known = {h.number: h for h in self.handles}
        changed = len(jobs) != len(known) or any(j.number not in known for j in jobs)
        ended: list[JobHandle] = []
        handles = []
        for job in jobs:
            handle = known.pop(job.number, None) or JobHandle(self._jobs, job, self)
            before, handle.job = handle.job.status, job
            changed |= before.state != job.status.state
            if before.state in ("queued", "running") and job.status.state not in ("queued", "running"):
                ended.append(handle)
            handles.append(handle)
        for gone in known.values():
            gone.deleteLater()
        self.handles = handles
        told = self._hear()
        self._hasten()
        waiting = any(h.state in ("running", "queued") for h in handles)
        self._timer.setInterval(HASTY if told is not None and told.behind else LIVELY if waiting else CALM)
        if changed:
            self.ran = self._jobs.ran()
            self.changed.emit()
        if told is not None:
            self.progressed.emit()
        for handle in ended:
            handle.wish = None
            self.ended.emit(handle)

    def _hear(self) -> JobHandle | None:
        """Reads some of what one job has told, those that run first; says which job it was."""
        for handle in sorted(self.handles, key=lambda h: (not h.running, -h.number)):
            unfinished = handle.ours and handle.state != "done"  # its row says how far it came
            if (handle.running or unfinished or handle.number in self._watched) and handle.behind:
                for event in handle.read_events():
                    self.heard.emit(handle, event)
                return handle
        return None

    def _hasten(self) -> None:
        """Kills what was asked long ago."""
        for handle in self.running:
            if handle.wish is not None and time.monotonic() - handle.asked > PATIENCE and self._jobs is not None:
                self._jobs.kill(handle.number)
                handle.asked = time.monotonic()
