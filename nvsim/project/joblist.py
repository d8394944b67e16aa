"""The jobs that a person ordered on a project, each a folder under logs/jobs: what was ordered, how it stands, the
events it sent, what it printed. Everything is in files, so that a job outlives the window that ordered it, and a window
that starts later finds it again.

A job is run by `nvsim.cli.worker` in a process of its own. Pausing and cancelling ask that process politely: its work
is kept at the last checkpoint, and it lets go of memory and of the project's writer lock.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import shutil
import signal
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import psutil

from nvsim.atomic import make_folder, write_text
from nvsim.errors import InputError
from nvsim.project.layout import Layout

State = Literal["queued", "running", "paused", "done", "failed", "cancelled", "interrupted"]
Wish = Literal["pause", "cancel"]
STATES: tuple[State, ...] = ("queued", "running", "paused", "done", "failed", "cancelled", "interrupted")
KEPT = 60  # ended jobs whose folders are kept
_ORDER, _STANDING, _WISH, _RAN = "order.json", "standing.json", "wish", "ran.txt"


@dataclass(frozen=True)
class Order:
    """What is to be run: `nvsim VERB ARGUMENTS`. A heavy job waits until no other heavy one runs on the project.
    `ordered` in seconds since the epoch; `title` is for the person."""

    verb: str
    arguments: tuple[str, ...]
    title: str
    heavy: bool = True
    ordered: float = 0.0


@dataclass(frozen=True)
class Standing:
    """How a job stands. pid and its birth name the process; seconds since the epoch; `worked` seconds of former runs;
    `code` the exit code once it ended; `message` one sentence about its end."""

    state: State = "queued"
    pid: int = 0
    born: float = 0.0
    started: float | None = None
    finished: float | None = None
    worked: float = 0.0
    code: int | None = None
    message: str = ""


@dataclass(frozen=True)
class Job:
    """One job and its folder. Jobs are numbered in the order in which they were ordered."""

    number: int
    folder: Path
    order: Order
    standing: Standing

    @property
    def events(self) -> Path:
        """JSON lines: events, each with the time it was sent ("at", seconds since the epoch)."""
        return self.folder / "events.jsonl"

    @property
    def output(self) -> Path:
        """What it printed on stdout: its result."""
        return self.folder / "output.txt"

    @property
    def messages(self) -> Path:
        """What it printed on stderr."""
        return self.folder / "messages.txt"


class JobList:
    """The jobs of the project at `root`, which need not exist yet. Any process may use it at any time."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root).expanduser().absolute()
        self.folder = Layout(self.root).jobs

    # Reading ----------------------------------------------------------------------------------------------------

    def jobs(self) -> list[Job]:
        """All jobs in their order. One whose process is gone is "interrupted", or what it was asked to become."""
        found = []
        with contextlib.suppress(OSError):
            names = sorted(e.name for e in os.scandir(self.folder) if e.name.isdigit())
            found = [job for name in names if (job := self.job(int(name))) is not None]
        return found

    def job(self, number: int) -> Job | None:
        """One job; None where there is none, or only a damaged one."""
        folder = self.folder / f"{number:06d}"
        try:
            data = json.loads((folder / _ORDER).read_text())
            order = Order(**{**data, "arguments": tuple(data["arguments"])})
        except (OSError, ValueError, TypeError, KeyError):
            return None
        try:
            standing = Standing(**json.loads((folder / _STANDING).read_text()))
        except (OSError, ValueError, TypeError):
            standing = Standing()
        if standing.state == "running" and not alive(standing.pid, standing.born):
            standing = self._left_by_the_dead(folder, standing)
        return Job(number, folder, order, standing)

    @staticmethod
    def _left_by_the_dead(folder: Path, standing: Standing) -> Standing:
        wish = _wish(folder)
        try:
            finished = max((folder / n).stat().st_mtime for n in (_STANDING, "events.jsonl") if (folder / n).exists())
        except (OSError, ValueError):
            finished = standing.started or 0.0
        message = "Its process ended without a word, most often by a kill or for want of memory." if not wish else ""
        worked = standing.worked + max(0.0, finished - (standing.started or finished))
        state: State = "interrupted" if wish is None else _FULFILLED[wish]
        return replace(standing, state=state, finished=finished, message=message, worked=worked)

    def ran(self) -> dict[int, float]:
        """Process number -> when it took its job, for every run there was, of forgotten jobs too: the project's own
        record of commands (`project.jobs`) has a row for each of them."""
        try:
            lines = (self.folder / _RAN).read_text().splitlines()
            return {int(pid): float(started) for pid, started in (line.split() for line in lines)}
        except (OSError, ValueError):
            return {}

    # Ordering ---------------------------------------------------------------------------------------------------

    def add(self, verb: str, arguments: Sequence[str], title: str, heavy: bool = True) -> Job:
        """A new job at the end of the queue; nothing is started. Raises InputError when the disk refuses."""
        make_folder(self.folder)
        with self._locked():
            self._prune()
            numbers = [int(e.name) for e in os.scandir(self.folder) if e.name.isdigit()]
            number = max(numbers, default=0) + 1
            folder = make_folder(self.folder / f"{number:06d}")
            order = Order(verb, tuple(arguments), title, heavy, time.time())
            write_text(folder / _ORDER, json.dumps(asdict(order)))
        return Job(number, folder, order, Standing())

    def again(self, number: int) -> None:
        """Puts a job that does not run back into the queue; it goes on from where it was."""
        with self._locked():
            job = self._need(number)
            if job.standing.state in ("queued", "running"):
                return
            (job.folder / _WISH).unlink(missing_ok=True)
            self._write(job, Standing(worked=job.standing.worked))

    def ask(self, number: int, wish: Wish) -> None:
        """Asks a job to pause or to be cancelled. One that waits obeys at once, one that runs as soon as it can."""
        with self._locked():
            job = self._need(number)
            state = job.standing.state
            if state == "running":
                write_text(job.folder / _WISH, wish)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(job.standing.pid, signal.SIGTERM)
            elif state in ("queued", "paused", "interrupted", "failed"):
                self._write(job, replace(job.standing, state=_FULFILLED[wish], message=""))

    def kill(self, number: int) -> None:
        """Ends a running job that does not obey, with everything it started."""
        job = self._need(number)
        if job.standing.state == "running":
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(job.standing.pid, signal.SIGKILL)

    def forget(self, number: int) -> None:
        """Removes a job that does not run from the list; what it made stays in the project."""
        with self._locked():
            job = self._need(number)
            if job.standing.state != "running":
                shutil.rmtree(job.folder, ignore_errors=True)

    # The worker's side ------------------------------------------------------------------------------------------

    def claim(self, number: int | None = None) -> Job | None:
        """Takes the job, or the next heavy one that waits, for this process. None when there is none, when it does not
        wait, or when it is heavy and another heavy one runs."""
        with self._locked():
            jobs = self.jobs()
            busy = any(j.order.heavy and j.standing.state == "running" for j in jobs)
            for job in jobs:
                wanted = job.order.heavy if number is None else job.number == number
                if not wanted or job.standing.state != "queued" or (job.order.heavy and busy):
                    continue
                me = psutil.Process()
                taken = Standing("running", me.pid, me.create_time(), time.time(), worked=job.standing.worked)
                self._write(job, taken)
                with open(self.folder / _RAN, "a") as file:
                    file.write(f"{taken.pid} {taken.started}\n")
                return replace(job, standing=taken)
        return None

    def finish(self, job: Job, code: int, message: str) -> Standing:
        """Writes down how the job of this process ended, by its exit code and by what was asked of it."""
        wish = _wish(job.folder)
        state: State = "failed"
        if code == 0:
            state = "done"
        elif code == 130:
            state = "interrupted" if wish is None else _FULFILLED[wish]
            message = "Something outside of NVSim asked it to stop." if wish is None else ""
        now = time.time()
        worked = job.standing.worked + now - (job.standing.started or now)
        standing = replace(job.standing, state=state, finished=now, worked=worked, code=code, message=message)
        self._write(job, standing)
        return standing

    # Inside -----------------------------------------------------------------------------------------------------

    def _need(self, number: int) -> Job:
        job = self.job(number)
        if job is None:
            raise InputError(f"There is no job {number} in {self.folder}; it was removed meanwhile.")
        return job

    @staticmethod
    def _write(job: Job, standing: Standing) -> None:
        write_text(job.folder / _STANDING, json.dumps(asdict(standing)))

    def _prune(self) -> None:
        ended = [j for j in self.jobs() if j.standing.state in ("done", "failed", "cancelled")]
        for job in ended[: max(0, len(ended) - KEPT)]:
            shutil.rmtree(job.folder, ignore_errors=True)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """One process at a time changes the list; held for milliseconds."""
        with open(self.folder / ".lock", "a+") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


_FULFILLED: dict[Wish, State] = {"pause": "paused", "cancel": "cancelled"}


def _wish(folder: Path) -> Wish | None:
    try:
        text = (folder / _WISH).read_text()
    except OSError:
        return None
    return "pause" if text == "pause" else "cancel" if text == "cancel" else None


def alive(pid: int, born: float) -> bool:
    """Whether the process of that number and birth is at work."""
    try:
        process = psutil.Process(pid)
        return abs(process.create_time() - born) < 1.0 and process.status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False
