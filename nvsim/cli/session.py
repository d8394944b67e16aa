"""The session of a command on a project: the writer's lock, the job's row, and the listener."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from nvsim.cli.console import listening
from nvsim.events import Listener
from nvsim.project.jobs.commands import JobJournal
from nvsim.project.project import Project


@contextmanager
def working(path: Path, verb: str, as_json: bool, create: bool = False) -> Iterator[tuple[Project, Listener]]:
    """Opens the project for writing and keeps a row for the job until the block ends. Raises InputError if the project
    cannot be opened."""
    project = Project.create_or_open(path) if create else Project.open(path, writable=True)
    with project, listening(as_json) as listen:
        journal = JobJournal(project.connection, verb, listen)
        try:
            yield project, journal
        except Exception as error:
            journal.end("failed", str(error))
            project.discard_if_new()
            raise
        except BaseException:
            journal.end("stopped", "stopped by request")
            raise
        journal.end("done")
