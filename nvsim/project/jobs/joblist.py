"""The jobs of a project, each a folder under logs/jobs with its order, status, events, and output.

All data is in files. A job therefore continues after the window that ordered it closes, and a window that starts later
finds it. `nvsim.cli.worker` runs each job of the window in a separate process, and a command in a terminal records
itself as a job. Pausing and canceling send the process of the job a signal. The process then stores its work in a
checkpoint and releases its memory and the project's writer lock.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import json
import os
import shutil
import signal
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error, make_folder, write_text
from nvsim.files.opening import is_folder, open_regular
from nvsim.project.jobs import worker_lock
from nvsim.project.jobs.files import (
    STATE_AFTER_REQUEST,
    STATUS,
    WISH,
    JobCommand,
    JobStatus,
    State,
    Wish,
    encode_order,
    encode_status,
    order_path,
    read_order,
    read_status,
    requested_state,
)
from nvsim.project.layout import Layout
from nvsim.project.work import WORK

__all__ = ["Job", "JobCommand", "JobList", "JobStatus", "State", "Wish"]

STOPPED: tuple[State, ...] = ("paused", "interrupted", "failed", "cancelled")
"""The states of jobs that can be continued."""
KEPT = 60  # finished jobs whose folders are kept
_MOST_JOBS = 500  # the newest jobs, which are the only ones read
_MOST_FOLDERS = 20_000
_DIGITS = 9
_LOCK = ".lock"
_ROOM = 1 << 20  # bytes; a disk with less free space counts as full


@dataclass(frozen=True)
class Job:
    """One job and its folder. Numbers follow the order of ordering.

    ours  this user ordered the job on this machine. Other jobs came with the project and never run; their state is
          "foreign" unless they are finished
    """

    number: int
    folder: Path
    order: JobCommand
    status: JobStatus
    ours: bool = True

    @property
    def resumable(self) -> bool:
        """Whether the window may run it: this user ordered it, and its command is one of the window."""
        return self.ours and self.order.verb in WORK

    @property
    def events(self) -> Path:
        """JSON lines: events, each with its time of sending ("at", seconds since the epoch)."""
        return self.folder / "events.jsonl"

    @property
    def output(self) -> Path:
        """The output of the job on stdout, which is its result. Missing for a command in a terminal."""
        return self.folder / "output.txt"

    @property
    def messages(self) -> Path:
        """The output of the job on stderr."""
        return self.folder / "messages.txt"


class JobList:
    """The jobs of the project at `root`, which need not exist yet. Any number of processes may use it."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root).expanduser().absolute()
        self.folder = Layout(self.root).jobs
        self._orders: dict[int, tuple[Any, JobCommand, bool]] = {}  # number -> stamp of the file, its order, ours

    # Reading ----------------------------------------------------------------------------------------------------

    def jobs(self) -> list[Job]:
        """All jobs by number. A job whose process has ended without a status is "interrupted", or paused or canceled
        if the user asked for that."""
        newest = self._numbers()[-_MOST_JOBS:]
        return [job for number in newest if (job := self.job(number)) is not None]

    def job(self, number: int) -> Job | None:
        """One job; None if it is missing or damaged."""
        folder = self.folder / f"{number:06d}"
        if not (is_folder(self.folder.parent) and is_folder(self.folder) and is_folder(folder)):
            return None
        try:
            order, ours = self._order(number, folder)
        except (OSError, ValueError):
            return None
        status = read_status(folder)
        if status.state == "running" and not worker_lock.is_job_running(folder):
            status = self._status_after_crash(folder, status)
        if not ours and status.state in ("queued", "paused", "interrupted"):
            status = replace(status, state="foreign", message="")
        return Job(number, folder, order, status, ours)

    def stamp(self) -> tuple[tuple[int, int], ...]:
        """Changes when a job begins or ends: the numbers of the jobs, and the times at which their status changed."""
        found = []
        for number in self._numbers()[-_MOST_JOBS:]:
            with contextlib.suppress(OSError):
                found.append((number, os.lstat(self.folder / f"{number:06d}" / STATUS).st_mtime_ns))
        return tuple(found)

    def _order(self, number: int, folder: Path) -> tuple[JobCommand, bool]:
        """The order of a job and whether it is ours, read again only if the file has changed."""
        found = os.lstat(order_path(folder))
        stamp = (found.st_mtime_ns, found.st_ctime_ns, found.st_size, found.st_ino)
        known = self._orders.get(number)
        if known is None or known[0] != stamp:
            known = self._orders[number] = (stamp, *read_order(self.root, number, folder))
        return known[1:]

    def _numbers(self) -> list[int]:
        """Numbers of the folders that may be jobs, in order."""
        if not (is_folder(self.folder.parent) and is_folder(self.folder)):
            return []
        with contextlib.suppress(OSError), os.scandir(self.folder) as entries:
            names = [entry.name for entry in itertools.islice(entries, _MOST_FOLDERS)]
            return sorted(int(n) for n in names if n.isascii() and n.isdigit() and 6 <= len(n) <= _DIGITS)
        return []

    @staticmethod
    def _status_after_crash(folder: Path, status: JobStatus) -> JobStatus:
        wish = requested_state(folder)
        try:
            finished = os.lstat(folder / STATUS).st_mtime
            with contextlib.suppress(FileNotFoundError):
                finished = max(finished, os.lstat(folder / "events.jsonl").st_mtime)
        except OSError:
            finished = status.started or 0.0
        message = "" if wish else "Its process ended without an error; it was probably killed, or memory ran out."
        with contextlib.suppress(OSError):
            if not wish and shutil.disk_usage(folder).free < _ROOM:
                message = "Its process ended, and the disk is full; free some space and run it again."
        worked = status.worked + max(0.0, finished - (status.started or finished))
        state: State = "interrupted" if wish is None else STATE_AFTER_REQUEST[wish]
        return replace(status, state=state, finished=finished, message=message, worked=worked)

    # Ordering ---------------------------------------------------------------------------------------------------

    def add(self, verb: str, arguments: Sequence[str], title: str, heavy: bool = True) -> Job:
        """Adds a job at the end of the queue without starting it. Raises InputError if `verb` cannot be a job, or the
        disk reports an error."""
        if verb not in WORK:
            raise InputError(f"`nvsim {verb}` cannot be a job; run it in a terminal.")
        self._make_folder()
        with self._locked():
            self._prune()
            return self._store(JobCommand(verb, tuple(arguments), title, heavy, time.time()), JobStatus())

    def begin(self, order: JobCommand) -> Job:
        """Records a command that this process runs, until `finish`. A command that was stopped before its end, and
        runs again, continues its job. Raises InputError if the disk reports an error."""
        self._make_folder()
        with self._locked():
            self._prune()
            for job in self.jobs():
                same = replace(job.order, ordered=order.ordered) == order
                if same and job.ours and job.status.state in STOPPED and not worker_lock.is_job_running(job.folder):
                    (job.folder / WISH).unlink(missing_ok=True)
                    return self._assign_job(job)
            return self._assign_job(self._store(order))

    def requeue(self, number: int) -> None:
        """Puts a job that does not run back into the queue, to continue its work. Raises InputError if the job was
        ordered by another user or on another machine."""
        with self._locked():
            job = self._existing_job(number)
            if not job.ours:
                raise InputError(f"“{job.order.title}” was ordered elsewhere; check what it does and order it again.")
            if not job.resumable:
                raise InputError(f"`nvsim {job.order.verb}` cannot be a job; run it in a terminal.")
            if job.status.state in ("queued", "running"):
                return
            try:
                (job.folder / WISH).unlink(missing_ok=True)
            except OSError as error:
                raise as_input_error(job.folder / WISH, error) from error
            self._write(job, JobStatus(worked=job.status.worked))

    def order_again(self, seen: Job) -> None:
        """Replaces a foreign job by an order of this user, which waits in the queue. `seen` is the job that the user
        has checked. Raises InputError if the job has changed since then."""
        with self._locked():
            job = self._existing_job(seen.number)
            if job.order != seen.order:
                raise InputError(f"“{seen.order.title}” has changed; check again what it does.")
            if job.ours or job.status.state == "running":
                return
            self._orders.pop(job.number, None)
            order = replace(job.order, ordered=time.time(), folder="")
            text = encode_order(self.root, job.number, order)
            try:
                shutil.rmtree(job.folder)  # including all other files in it
            except OSError as error:
                raise as_input_error(job.folder, error) from error
            write_text(order_path(make_folder(job.folder)), text)

    def ask(self, number: int, wish: Wish) -> None:
        """Asks a job to pause or cancel. A waiting job obeys at once, a running one as soon as possible."""
        with self._locked():
            job = self._existing_job(number)
            state = job.status.state
            if state == "running":
                write_text(job.folder / WISH, wish)
                worker_lock.send(job.folder, job.status.pid, signal.SIGTERM)
            elif state in ("queued", "paused", "interrupted", "failed"):
                self._write(job, replace(job.status, state=STATE_AFTER_REQUEST[wish], message=""))

    def kill(self, number: int) -> None:
        """Kills a running job and all processes that it started."""
        job = self._existing_job(number)
        if job.status.state == "running":
            worker_lock.send(job.folder, job.status.pid, signal.SIGKILL, everything=True)

    def remove(self, number: int) -> None:
        """Removes a job that does not run from the list; its results stay in the project."""
        with self._locked():
            job = self._existing_job(number)
            if job.status.state != "running":
                shutil.rmtree(job.folder, ignore_errors=True)

    # The worker's side ------------------------------------------------------------------------------------------

    def claim(self, number: int | None = None) -> Job | None:
        """Assigns a job to this process: the job `number`, or the next heavy job in the queue. Returns None if there is
        no such job, if it does not wait or is not ours, or if it is heavy and another heavy job runs."""
        with self._locked():
            jobs = self.jobs()
            busy = any(j.order.heavy and j.status.state == "running" for j in jobs)
            for job in jobs:
                wanted = job.order.heavy if number is None else job.number == number
                if not wanted or not job.ours or job.status.state != "queued" or (job.order.heavy and busy):
                    continue
                with contextlib.suppress(BlockingIOError):  # processes of the previous run are still working
                    return self._assign_job(job)
        return None

    def finish(self, job: Job, code: int, message: str) -> JobStatus:
        """Stores how the job of this process ended, by its exit code and the request of the user."""
        wish = requested_state(job.folder)
        state: State = "failed"
        if code == 0:
            state = "done"
        elif code == 130:
            state = "interrupted" if wish is None else STATE_AFTER_REQUEST[wish]
            message = "It was asked to stop from outside the window." if wish is None else ""
        now = time.time()
        worked = job.status.worked + max(0.0, now - (job.status.started or now))
        status = replace(job.status, state=state, finished=now, worked=worked, code=code, message=message)
        self._write(job, status)
        worker_lock.release(job.folder)
        return status

    def discard(self, job: Job) -> None:
        """Removes the job of this process, and the folders of the list if they are empty then."""
        worker_lock.release(job.folder)
        shutil.rmtree(job.folder, ignore_errors=True)
        if not self._numbers():
            with contextlib.suppress(OSError):
                (self.folder / _LOCK).unlink(missing_ok=True)
                self.folder.rmdir()
                self.folder.parent.rmdir()
                self.root.rmdir()

    # Inside -----------------------------------------------------------------------------------------------------

    def _store(self, order: JobCommand, status: JobStatus | None = None) -> Job:
        """A new job. Without a status the process runs it itself, so it needs no proof if the secret is missing."""
        number = max(self._numbers(), default=0) + 1
        if number >= 10**_DIGITS:
            raise InputError(f"{self.folder} has a job with the number {number - 1}; remove that folder.")
        try:
            text = encode_order(self.root, number, order)
        except InputError:
            if status is not None:
                raise
            text = json.dumps(asdict(order))
        folder = make_folder(self.folder / f"{number:06d}")
        write_text(order_path(folder), text)
        return Job(number, folder, order, status or JobStatus())

    def _assign_job(self, job: Job) -> Job:
        """Assigns a job to this process. Raises InputError, and BlockingIOError if another process runs it."""
        try:
            worker_lock.acquire(job.folder)
            taken = JobStatus("running", os.getpid(), time.time(), worked=job.status.worked)
            self._write(job, taken)
        except BlockingIOError:
            raise
        except OSError as error:
            raise as_input_error(job.folder, error) from error
        return replace(job, status=taken)

    def _existing_job(self, number: int) -> Job:
        job = self.job(number)
        if job is None:
            raise InputError(f"There is no job {number} in {self.folder}; it was removed.")
        return job

    @staticmethod
    def _write(job: Job, status: JobStatus) -> None:
        write_text(job.folder / STATUS, encode_status(status))

    def _prune(self) -> None:
        ended = [j for j in self.jobs() if j.status.state in ("done", "failed", "cancelled")]
        for job in ended[: max(0, len(ended) - KEPT)]:
            shutil.rmtree(job.folder, ignore_errors=True)

    def _make_folder(self) -> None:
        for folder in (self.folder.parent, self.folder):
            if folder.is_symlink():
                raise InputError(f"{folder} is a symbolic link, which NVSim does not follow here; remove it.")
        make_folder(self.folder)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        """Lets one process at a time change the list; held for milliseconds. Raises InputError if the disk reports an
        error."""
        self._make_folder()
        path = self.folder / _LOCK
        try:
            descriptor = open_regular(path, os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise as_input_error(path, error) from error
        with open(descriptor, "r+") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX)
            except OSError as error:
                raise as_input_error(path, error) from error
            yield
