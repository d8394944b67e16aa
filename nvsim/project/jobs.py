"""What runs or ran on a project: one row per command, kept alive while it works, so that a window that starts later
sees what was interrupted."""

from __future__ import annotations

import os
import sqlite3
import time
from dataclasses import dataclass
from pathlib import Path

from nvsim.events import Event, Listener, Progress
from nvsim.files import tables
from nvsim.files.database_writing import refused
from nvsim.files.tables import COUNT, NUMBER, TEXT
from nvsim.project.job_status import RAN, Ran
from nvsim.project.worker_lock import has_open

_BEAT = 1.0  # seconds between updates of a job's row


@dataclass(frozen=True)
class JobRecord:
    """stage: the command's verb. state: "interrupted" where its process is gone.
    progress: 0 to 1. started, finished: seconds since the epoch. pid: of the process that runs or ran it."""

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
    """All jobs, newest first. `lock` is the file of the project's one writer: the process that has it open is the one
    that runs. Raises InputError where the database at `path` is damaged."""
    rows = tables.read(connection, path, "jobs", _JOB, "ORDER BY id DESC LIMIT 200")
    result = []
    for id, stage, pid, state, started, finished, done, total, message in rows:
        if state not in RAN or (state == "running" and not has_open(pid, lock)):
            state = "interrupted"
        share = 1.0 if state == "done" else (done / total if total else 0.0)
        result.append(JobRecord(id, stage, state, share, started, finished, message, pid))
    return result


class JobJournal:
    """Keeps the row of one job while it runs; also a listener that passes events on."""

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
        now = time.time()
        self._write(
            "UPDATE jobs SET state = ?, message = ?, updated = ?, finished = ? WHERE id = ?",
            (state, _storable(message), now, now, self._id),
        )

    def _write(self, statement: str, values: tuple[object, ...]) -> int | None:
        """The number of the row that was added. Raises InputError when the disk refuses."""
        try:
            return self._connection.execute(statement, values).lastrowid
        except sqlite3.Error as error:
            raise refused(getattr(self._connection, "path", Path("project.db")), error) from error


def _storable(text: str) -> str:
    """`text` as a database takes it: names of files need not be UTF-8."""
    return text.encode(errors="backslashreplace").decode()
