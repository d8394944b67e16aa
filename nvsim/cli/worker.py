"""Run one job of a project's list and then start the next: `python -m nvsim.cli.worker PROJECT [NUMBER]`.

The command of a job must be one that the window offers, for its own project, with valid options.

The worker has its own session and low priority, so it survives the window that started it and does not slow it down.
Its events are appended to a file in the job's folder.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

from nvsim.cli.terminal import print_lines
from nvsim.errors import InputError, value_text
from nvsim.events import Failed, Log
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import open_own_file, read_end
from nvsim.kernel_threads import limit
from nvsim.project.jobs.files import EventWriter
from nvsim.project.jobs.joblist import Job, JobCommand, JobList
from nvsim.project.work import WORK


def check_order(root: Path, order: JobCommand, confined: bool = False) -> None:
    """Raises InputError if `order` is not a job for the project at `root`, or this version does not have one of its
    options. With `confined` also if an option names another machine, an endpoint, or a path outside the project; a
    project from another person may contain such jobs."""
    from nvsim.cli.arguments import parse
    from nvsim.cli.mistakes import OptionError
    from nvsim.cli.options import command_of, path_values

    verb = order.verb
    if verb not in WORK:
        raise InputError(f"`nvsim {verb}` cannot be a job; run it in a terminal.")
    # The parser has its own options, one of which writes a file.
    own = [word for word in order.arguments if word.replace("_", "-").startswith("--tyro-")]
    if own:
        raise InputError(f"`nvsim {verb}` has no option {own[0]}; start the job again.")
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            parsed = parse(command_of(verb), list(order.arguments), verb)
    except (OptionError, SystemExit) as mistake:
        if not confined:  # the log of the job has the complete sentence
            print_lines(mistake, error=True)
        raise InputError(_invalid_option_message(order, str(mistake))) from mistake
    if parsed.project.expanduser().resolve() != root.resolve():
        raise InputError(f"The job is for another project, {parsed.project}; start it there.")
    cluster = getattr(parsed, "cluster", None)
    if confined and cluster is not None and cluster.executor != "local":
        raise InputError(
            f"This job would run on a cluster at {cluster.address}, which another person chose; start the "
            "job again from the Jobs menu."
        )
    asked = getattr(parsed, "asked", None)
    if confined and asked is not None and (asked.endpoint or asked.key_variable):
        raise InputError(
            f"This job would send data to {value_text(asked.endpoint or 'an endpoint')}, which another person chose; "
            "start the job again from the Jobs menu."
        )
    for name, path in path_values(parsed) if confined else ():
        if not path.expanduser().resolve().is_relative_to(root.resolve()):
            raise InputError(
                f"The option {name} of this job is {path}, outside of the project, which another person chose; start "
                "the job again from the Jobs menu and choose the path yourself."
            )


def _invalid_option_message(order: JobCommand, report: str) -> str:
    """One sentence about an option that this version does not accept. `report` is the sentence about it, which
    names the option first. Jobs that an earlier version stored may contain options that were renamed or removed."""
    found = re.search(r"--[A-Za-z][\w.-]*", report)
    option = f"its option {found[0]}" if found else "one of its options"
    return (
        f"The job “{order.title}” cannot run because {option} is not valid in this version of NVSim; remove the job "
        "and add it again from the Jobs menu."
    )


NICE = 15  # the render process has 5, and must answer while a submap trains
LIGHT_NICE = 5
_LAST = 1 << 16  # bytes at the end of its output that are searched for the last line
_started: list[subprocess.Popen[bytes]] = []


def start_worker(root: Path, number: int | None = None, threads: int = 0) -> None:
    """Starts a process for the job, or for the next queued one. It ends if there is none. The process and its
    successors use at most `threads` threads, 0 for all cores."""
    _started[:] = [p for p in _started if p.poll() is None]  # forget finished processes
    command = [sys.executable, "-P", "-m", "nvsim.cli.worker", str(root), *([] if number is None else [str(number)])]
    null = subprocess.DEVNULL
    environment = {**os.environ, **limit(threads)} if threads else None
    _started.append(
        subprocess.Popen(command, start_new_session=True, stdin=null, stdout=null, stderr=null, env=environment)
    )


def main(arguments: list[str]) -> int:
    """Runs the worker; returns the exit code of the job, 0 if there was none."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the parent worker ignored it
    jobs = JobList(Path(arguments[0]))
    try:
        job = jobs.claim(int(arguments[1]) if len(arguments) > 1 else None)
    except InputError as error:
        print_lines(error, error=True)
        return 2
    if job is None:
        return 0
    if hasattr(os, "nice"):
        os.nice(NICE if job.order.heavy else LIGHT_NICE)
    code, message = _run(jobs, job)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the job is done; only its end must be recorded
    status = jobs.finish(job, code, message)
    # Jobs queued after a failed job usually depend on it, so they wait for the user.
    if job.order.heavy and status.state in ("done", "cancelled"):
        start_worker(jobs.root)
    return code


def _run(jobs: JobList, job: Job) -> tuple[int, str]:
    """Runs the job; returns the exit code, and one sentence about its end."""
    from nvsim.cli.console import redirect_events
    from nvsim.cli.main import main as command

    try:
        _redirect(1, job.output)
        _redirect(2, job.messages)
        hear = EventWriter(job.events)
    except OSError as error:
        return 2, str(as_input_error(Path(error.filename or job.folder), error))
    hear(Log("Started." if job.status.worked == 0 else "Continued."))
    try:
        if job.order.folder:
            os.chdir(job.order.folder)
        check_order(jobs.root, job.order)
        with redirect_events(hear):
            code = command([*job.order.verb.split(), *job.order.arguments])
    except InputError as error:
        code = 2
        hear(Failed(job.order.verb, str(error), code))
    except OSError as error:  # the folder of the order is gone
        code = 2
        hear(Failed(job.order.verb, str(as_input_error(Path(job.order.folder), error)), code))
    message = hear.message
    return code, message or (_last_words(job.output) if code == 0 else "")


def _last_words(output: Path) -> str:
    """The last line of the output, unless it is JSON."""
    sys.stdout.flush()
    try:
        lines = read_end(output, _LAST).decode(errors="replace").strip().splitlines()
    except OSError:
        return ""
    return lines[-1] if lines and not lines[-1].startswith(("{", "[")) else ""


def _redirect(descriptor: int, path: Path) -> None:
    """Redirects the output of the process and its future children into the file."""
    file = open_own_file(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(file, descriptor)
    os.close(file)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
