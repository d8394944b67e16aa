"""The session of a command on a project: the writer's lock, the job's row, and the listener."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli.console import listening
from nvsim.errors import InputError
from nvsim.events import Listener

if TYPE_CHECKING:
    from nvsim.project.project import Project


@contextmanager
def working(path: Path, verb: str, as_json: bool, create: bool = False) -> Iterator[tuple[Project, Listener]]:
    """Opens the project for writing and keeps a row for the job until the block ends. Raises InputError if the project
    cannot be opened."""
    from nvsim.project.jobs.commands import JobJournal
    from nvsim.project.project import Project

    project = Project.create_or_open(path) if create else Project.open(path, writable=True)
    with project, listening(as_json) as listen:
        journal = JobJournal(project.connection, verb, listen)
        try:
            _refuse_without_images(project, verb)
            yield project, journal
        except Exception as error:
            journal.end("failed", str(error))
            project.discard_if_new()
            raise
        except BaseException:
            journal.end("stopped", "stopped by request")
            raise
        journal.end("done")


def _refuse_without_images(project: Project, verb: str) -> None:
    """Raises InputError if a command needs images and the project has none."""
    from nvsim.project.work import NEEDS_IMAGES, NO_IMAGES

    if verb in NEEDS_IMAGES:
        capture = project.capture()
        if capture is not None and not capture.has_images:
            raise InputError(f"`nvsim {verb}` needs images, but {NO_IMAGES}: {project.layout.root}.")
