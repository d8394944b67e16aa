"""The session of a command on a project: the writer's lock, the job that records it, and the listener."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli import console
from nvsim.errors import InputError
from nvsim.events import Event, Listener, Log, Warning
from nvsim.files.atomic import as_input_error

if TYPE_CHECKING:
    from nvsim.cli.options import Command
    from nvsim.project.project import Project

_READING = ("evaluate ", "export ", "graph check", "graph compare", "graph propose", "graph review")
"""The first words of the commands that measure or write the results of a project."""


@contextmanager
def project_job(path: Path, verb: str, as_json: bool, create: bool = False) -> Iterator[tuple[Project, Listener]]:
    """Opens the project for writing, and records the command as a job until the block ends. Raises InputError if the
    project cannot be opened."""
    from nvsim.project.project import Project

    project = Project.create_or_open(path) if create else Project.open(path, writable=True)
    with project, console.event_listener(as_json) as listen, _recorded(project, verb, listen) as hear:
        try:
            _refuse_without_images(project, verb)
            yield project, hear
        except Exception:
            project.discard_if_new()
            raise


@contextmanager
def _recorded(project: Project, verb: str, listen: Listener) -> Iterator[Listener]:
    """Keeps the job folder of this command. The worker of a job of the window has one already."""
    if console.forwards_events():
        yield listen
        return
    from nvsim.project.jobs.files import EventWriter
    from nvsim.project.jobs.joblist import JobCommand, JobList
    from nvsim.project.layout import Layout
    from nvsim.project.work import WORK

    verb, arguments = console.command() or (verb, ())
    row = WORK.get(verb)
    title, heavy = (f"nvsim {verb}", True) if row is None else (row.title, row.heavy)
    jobs = JobList(project.root)
    job = jobs.begin(JobCommand(verb, arguments, title, heavy, time.time(), os.getcwd()))
    try:
        record = EventWriter(job.events)
    except OSError as error:
        raise as_input_error(job.events, error) from error
    with closing(record):

        def record_and_forward(event: Event) -> None:
            record(event)
            listen(event)

        record(Log("Started." if job.status.worked == 0 else "Continued."))
        try:
            yield record_and_forward
        except Exception as error:
            if Layout(project.root).database.exists():
                jobs.finish(job, 2, str(error))
            else:
                jobs.discard(job)  # a refused import leaves no files
            raise
        except BaseException:
            jobs.finish(job, 130, "")
            raise
        jobs.finish(job, 0, record.message)


def warn_of_outdated_results(verb: str, given: Command) -> None:
    """Warns if a command reads results that were computed before the capture or the splat of their project changed. It
    covers every project among the arguments. Stages that the command does not need are skipped. Raises InputError if a
    project is damaged."""
    if not verb.startswith(_READING):
        return
    from nvsim.cli.options import path_values
    from nvsim.project.outdated import outdated_sentences
    from nvsim.project.path_kind import path_kind
    from nvsim.project.project import Project
    from nvsim.project.work import STAGES, WORK

    needed = WORK[verb].needs if verb in WORK else None
    paths = dict.fromkeys(path for _, path in path_values(given))
    projects = [path for path in paths if path_kind(path) == "project"]
    for path in projects:
        with Project.open(path) as project:
            found = " ".join(outdated_sentences(project, needed or STAGES[-1]))
        if found:
            with console.event_listener(False) as listen:
                listen(Warning(f"{path}: {found}" if len(projects) > 1 else found, verb))


def _refuse_without_images(project: Project, verb: str) -> None:
    """Raises InputError if a command needs images and the project has none."""
    from nvsim.project.work import NEEDS_IMAGES, NO_IMAGES

    if verb in NEEDS_IMAGES:
        capture = project.capture()
        if capture is not None and not capture.has_images:
            raise InputError(f"`nvsim {verb}` needs images, but {NO_IMAGES}: {project.layout.root}.")
