"""The queue of jobs of the open project. It polls the job folders a few times per second and never blocks.

Jobs are independent processes. They continue after the window closes, and a new window shows their current state.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, QTimer, Signal

from nvsim.cli.worker import check_order, start_worker
from nvsim.errors import InputError
from nvsim.files.opening import is_folder
from nvsim.project.jobs.files import EventFile
from nvsim.project.jobs.joblist import STOPPED as AGAIN
from nvsim.project.jobs.joblist import Job, JobList, State, Wish
from nvsim.project.layout import Layout
from nvsim_app.jobs.history import JobReport

HASTY, LIVELY, CALM = 60, 250, 1000  # milliseconds between two polls: if events wait, if a job runs, otherwise
BYTES_A_LOOK = 48 << 10  # maximum bytes of events per poll, about 3 ms of parsing
PATIENCE = 15.0  # seconds until a job that does not end on request is killed
STOPPED: tuple[State, ...] = ("paused", "cancelled")  # by the user, before the end
ELSEWHERE = "it was ordered elsewhere; inspect it first"
ORDERED_ELSEWHERE = "This job came with the project from another user; it runs only if you order it again here."


class JobHandle(QObject):
    """One job of the queue: its state at the last poll (`job`) and its collected events (`history`)."""

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
    def is_own(self) -> bool:
        """Whether this user ordered the job on this machine. Other jobs never run by themselves."""
        return self.job.ours

    def picture(self, path: str) -> Path | None:
        """The file of an image that the job reported, always in the pictures folder of the project; None if that
        folder does not exist."""
        folder = Layout(self._jobs.root).pictures
        return folder / Path(path).name if "\0" not in path and is_folder(folder) else None

    @property
    def message(self) -> str:
        """A sentence about the job: the error and its fix, the current work, or how far it came."""
        status, progress = self.job.status, self.history.progress
        if self.state == "foreign":
            return ORDERED_ELSEWHERE
        if self.state in ("failed", "interrupted"):
            return status.message or self.history.failure
        if self.state == "running":
            if self.wish is not None:
                return "Pausing at the last checkpoint…" if self.wish == "pause" else "Canceling…"
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
        """The progress of the current stage."""
        progress = self.history.progress
        assert progress is not None  # checked by the caller
        return f"{100 * self.history.share:.0f} % of {progress.stage}: {progress.detail}".rstrip(": ")

    @property
    def work_seconds(self) -> float:
        """Seconds of work without pauses."""
        status = self.job.status
        now = time.time() - status.started if self.running and status.started else 0.0
        return status.worked + now

    def read_events(self) -> list[object]:
        """Reads the events since the last call, and adds them to the history."""
        events = self._file.read(BYTES_A_LOOK)
        for at, event in events:
            self.history.receive(at, event)
        return [event for _, event in events]

    @property
    def has_unread_events(self) -> bool:
        """Whether there are unread events."""
        return self._file.has_unread_events


class JobQueue(QObject):
    """The jobs of the open project.

    changed()                         a job was added or removed, or its state changed
    progressed()                      new events were read; at most a few times per second
    heard(JobHandle, Event)           each event, including past ones
    ended(JobHandle)                  a job that was running or queued has ended
    found(list of JobHandle)          once per project: jobs that wait for the user
    foundForeign(list of JobHandle)   once per project: jobs that another user ordered
    """

    changed = Signal()
    progressed = Signal()
    heard = Signal(object, object)
    ended = Signal(object)
    found = Signal(object)
    foundForeign = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._jobs: JobList | None = None
        self.handles: list[JobHandle] = []  # in the order of their creation
        self._watched: set[int] = set()
        self.threads = 0  # maximum number of threads of a job, 0 for all cores
        self._timer = QTimer(self, interval=CALM)
        self._timer.timeout.connect(self._update_jobs)

    # The project ------------------------------------------------------------------------------------------------

    def set_project(self, project: Path | None) -> None:
        """Shows the jobs of `project`; None shows none."""
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
            self._update_jobs()
            waiting = [h for h in self.handles if h.job.resumable and h.state in ("interrupted", "paused", "queued")]
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
        """Stops polling. The jobs continue."""
        self._timer.stop()

    def read_events_of(self, handle: JobHandle) -> None:
        """Reads the events of a job even if it has ended."""
        self._watched.add(handle.number)
        if handle.has_unread_events:
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
        """Orders `nvsim VERB ARGUMENTS` for `project`. Light jobs start immediately; heavy jobs wait for earlier heavy
        jobs. Raises InputError if the project folder is not writable."""
        jobs = self._jobs if self._jobs is not None and self.project == Path(project).absolute() else JobList(project)
        job = jobs.add(verb, arguments, title, heavy)
        self._begin(jobs, None if heavy else job.number)
        if jobs is not self._jobs:
            return JobHandle(jobs, job, self)
        self._update_jobs()
        made = self.handle(job.number)
        assert made is not None  # `_update_jobs` has just found it
        return made

    def pause(self, handle: JobHandle) -> None:
        """Stops a job at its last checkpoint. `resume` continues it."""
        self._ask(handle, "pause")

    def cancel(self, handle: JobHandle) -> None:
        """Ends a job. Finished results remain, and a new start continues from them."""
        self._ask(handle, "cancel")

    def resume(self, *handles: JobHandle) -> None:
        """Continues paused, interrupted, canceled, or failed jobs, and starts waiting ones, as soon as no other heavy
        job runs. Jobs for which `why_not_resume` gives a reason are ignored."""
        if self._jobs is None:
            return
        allowed = [h for h in handles if not self.why_not_resume(h)]
        for handle in allowed:
            if handle.state != "queued":
                self._jobs.requeue(handle.number)
        light = [h.number for h in allowed if not h.job.order.heavy]
        heavy = [h.number for h in allowed if h.job.order.heavy]
        for number in (*light, *sorted(heavy)[:1]):  # the worker starts the next heavy job itself
            self._begin(self._jobs, number)
        self._update_jobs()

    def why_not_resume(self, handle: JobHandle) -> str:
        """Why a job cannot be continued or started now, "" if it can. A waiting job needs the results of those before
        it, so these come first."""
        if not handle.is_own:
            return ELSEWHERE
        if not handle.job.resumable:
            return "it was started in a terminal; run it there again"
        if handle.state in AGAIN:
            return ""
        if handle.state != "queued":
            return f"it is {handle.state}"
        before = [h for h in self.handles if h.job.resumable and h.number < handle.number and h.job.order.heavy]
        if not handle.job.order.heavy:
            return ""
        if self.busy:
            return "another job is running"
        first = next((h for h in before if h.state in ("paused", "interrupted", "queued")), None)
        return "" if first is None else f"“{first.title}” comes first; continue or cancel it"

    def why_not_order_again(self, job: Job) -> str:
        """Why a job of another user cannot be ordered here unchanged, "" if it can."""
        if self._jobs is None:
            return "no project is open"
        try:
            check_order(self._jobs.root, job.order, confined=True)
        except InputError as error:
            return str(error)
        return ""

    def order_again(self, seen: Job) -> None:
        """Orders the job of another user here, exactly as the user has `seen` it. Raises InputError if the job is not
        allowed or has changed meanwhile."""
        if self._jobs is None:
            return
        check_order(self._jobs.root, seen.order, confined=True)
        self._jobs.order_again(seen)
        self._begin(self._jobs, None if seen.order.heavy else seen.number)
        self._update_jobs()

    def begin_waiting(self) -> None:
        """Starts the waiting jobs, unless a heavy job runs."""
        if self._jobs is not None and not self.busy:
            self._begin(self._jobs, None)

    def remove(self, handle: JobHandle) -> None:
        """Removes a job that does not run from the list."""
        if self._jobs is not None and not handle.running:
            with contextlib.suppress(InputError):  # the job may be removed already
                self._jobs.remove(handle.number)
            self._update_jobs()

    def _ask(self, handle: JobHandle, wish: Wish) -> None:
        if self._jobs is None:
            return
        with contextlib.suppress(InputError):  # the job may be removed already
            self._jobs.ask(handle.number, wish)
        if handle.running:
            handle.wish, handle.asked = wish, time.monotonic()
        self._update_jobs()
        self.changed.emit()

    def _begin(self, jobs: JobList, number: int | None) -> None:
        start_worker(jobs.root, number, self.threads)
        self._timer.setInterval(LIVELY)

    # Polling ----------------------------------------------------------------------------------------------------

    def _update_jobs(self) -> None:
        """Updates all jobs; takes a few milliseconds at most."""
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
        heard_from = self._read_some_events()
        self._kill_late_jobs()
        waiting = any(h.state in ("running", "queued") for h in handles)
        self._timer.setInterval(
            HASTY if heard_from is not None and heard_from.has_unread_events else LIVELY if waiting else CALM
        )
        if changed:
            self.changed.emit()
        if heard_from is not None:
            self.progressed.emit()
        for handle in ended:
            handle.wish = None
            self.ended.emit(handle)
            if handle.job.order.folder and handle.state == "done":
                self.begin_waiting()  # a command in a terminal starts no next job

    def _read_some_events(self) -> JobHandle | None:
        """Reads some events of one job, running jobs first. Returns the job, None if there are no events."""
        for handle in sorted(self.handles, key=lambda h: (not h.running, -h.number)):
            unfinished = handle.is_own and handle.state != "done"  # its row shows its progress
            if (handle.running or unfinished or handle.number in self._watched) and handle.has_unread_events:
                for event in handle.read_events():
                    self.heard.emit(handle, event)
                return handle
        return None

    def _kill_late_jobs(self) -> None:
        """Kills jobs that have not ended within PATIENCE seconds of a request."""
        for handle in self.running:
            if handle.wish is not None and time.monotonic() - handle.asked > PATIENCE and self._jobs is not None:
                self._jobs.kill(handle.number)
                handle.asked = time.monotonic()
