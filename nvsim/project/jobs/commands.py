"""The commands that run or ran on a project: one row per command, updated while it runs. A window that starts later can
therefore show interrupted commands."""

from __future__ import annotations

import os
import sqlite3
import time
from dataclasses import dataclass
from pathlib import Path

from nvsim.events import Event, Listener, Progress
from nvsim.files import tables
from nvsim.files.databases import refused
from nvsim.files.tables import COUNT, NUMBER, TEXT
from nvsim.project.jobs.files import RAN, Ran
from nvsim.project.jobs.worker_lock import has_open

_BEAT = 1.0  # seconds between updates of a job's row


@dataclass(frozen=True)
class JobRecord:
    """A command that runs or ran on the project.

    stage              verb of the command
    state              "interrupted" if the process ended unexpectedly
    progress           0 to 1
    started, finished  seconds since the epoch
    pid                process id
    """

    id: int
    stage: str
    state: Ran
    progress: float
    started: float
    finished: float | None
    message: str
    pid: int = 0


_JOB = {
    "id": COUNT,
    "stage": TEXT,
    "pid": COUNT,
    "state": TEXT,
    "started": NUMBER,
    "finished": NUMBER.or_null,
    "done": COUNT,
    "total": COUNT,
    "message": TEXT,
}


def read_jobs(connection: sqlite3.Connection, path: Path, lock: Path) -> list[JobRecord]:
    """The newest 200 jobs, newest first. `lock` is the lock file of the project's only writer. A job runs if its
    process has this file open. Raises InputError if the database at `path` is damaged."""
    rows = tables.read(connection, path, "jobs", _JOB, "ORDER BY id DESC LIMIT 200")
    result = []
    for id, stage, pid, state, started, finished, done, total, message in rows:
        if state not in RAN or (state == "running" and not has_open(pid, lock)):
            state = "interrupted"
        share = 1.0 if state == "done" else (done / total if total else 0.0)
        result.append(JobRecord(id, stage, state, share, started, finished, message, pid))
    return result


class JobJournal:
    """Updates the row of one job while it runs. It is a listener that also passes events on."""

    def __init__(self, connection: sqlite3.Connection, stage: str, listen: Listener) -> None:
        self._connection = connection
        self._listen = listen
        self._beat = 0.0
        now = time.time()
        self._id = self._write(
            "INSERT INTO jobs (stage, pid, state, started, updated) VALUES (?, ?, 'running', ?, ?)",
            (stage, os.getpid(), now, now),
        )

    def __call__(self, event: Event) -> None:
        if isinstance(event, Progress) and time.monotonic() - self._beat > _BEAT:
            self._beat = time.monotonic()
            self._write(
                "UPDATE jobs SET done = ?, total = ?, updated = ?, message = ? WHERE id = ?",
                (event.done, event.total, time.time(), _storable(f"{event.stage} {event.detail}".strip()), self._id),
            )
        self._listen(event)

    def end(self, state: Ran, message: str = "") -> None:
        """Stores the final state. Raises InputError if the disk reports an error."""
        now = time.time()
        self._write(
            "UPDATE jobs SET state = ?, message = ?, updated = ?, finished = ? WHERE id = ?",
            (state, _storable(message), now, now, self._id),
        )

    def _write(self, statement: str, values: tuple[object, ...]) -> int | None:
        """The number of the last inserted row. Raises InputError if the disk reports an error."""
        try:
            return self._connection.execute(statement, values).lastrowid
        except sqlite3.Error as error:
            raise refused(getattr(self._connection, "path", Path("project.db")), error) from error


def _storable(text: str) -> str:
    """`text` in a form that a database can store, because file names need not be valid UTF-8."""
    return text.encode(errors="backslashreplace").decode()
