"""Runs one job of a project's list and then hands on to the next: `python -m nvsim.cli.worker PROJECT [NUMBER]`.

In a session of its own and at low priority, so that it neither dies with the window that started it nor slows it down.
Its events go to the job's folder line by line.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from nvsim.cli.orders import check_order
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.events import Done, Event, Failed, Log
from nvsim.files.atomic import as_input_error
from nvsim.files.nofollow import read_end
from nvsim.files.opening import own_file
from nvsim.kernel_threads import limit
from nvsim.project.job_events import event_line
from nvsim.project.joblist import Job, JobList

NICE = 15  # the drawing process has 5, and is asked for images while a submap trains
LIGHT_NICE = 5
_LAST = 1 << 16  # bytes of what it printed that are looked at for its last words
_started: list[subprocess.Popen[bytes]] = []


def start_worker(root: Path, number: int | None = None, threads: int = 0) -> None:
    """Starts a process for the job, or for the next that waits; it ends by itself when there is none. It computes with
    so many `threads` at most, 0 for all cores, and so do those that follow it."""
    _started[:] = [p for p in _started if p.poll() is None]  # lets the ended ones go
    command = [sys.executable, "-P", "-m", "nvsim.cli.worker", str(root), *([] if number is None else [str(number)])]
    null = subprocess.DEVNULL
    environment = {**os.environ, **limit(threads)} if threads else None
    _started.append(
        subprocess.Popen(command, start_new_session=True, stdin=null, stdout=null, stderr=null, env=environment)
    )


def main(arguments: list[str]) -> int:
    """The exit code of the job, 0 where there was nothing to do."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the worker that started this one had it ignored
    jobs = JobList(Path(arguments[0]))
    try:
        job = jobs.claim(int(arguments[1]) if len(arguments) > 1 else None)
    except InputError as error:
        say(error, error=True)
        return 2
    if job is None:
        return 0
    if hasattr(os, "nice"):
        os.nice(NICE if job.order.heavy else LIGHT_NICE)
    code, message = _run(jobs, job)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the work is over; only its end is to be written down
    status = jobs.finish(job, code, message)
    # What waits behind a failure most often builds on it, and waits for the user.
    if job.order.heavy and status.state in ("done", "cancelled"):
        start_worker(jobs.root)
    return code


def _run(jobs: JobList, job: Job) -> tuple[int, str]:
    """The exit code, and one sentence about the end."""
    from nvsim.cli.console import heard_by
    from nvsim.cli.main import main as command

    try:
        _redirect(1, job.output)
        _redirect(2, job.messages)
        events = own_file(job.events, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    except OSError as error:
        return 2, str(as_input_error(Path(error.filename or job.folder), error))
    message = ""

    with os.fdopen(events, "ab", buffering=0) as file:

        def write(event: Event) -> None:
            with contextlib.suppress(OSError):  # on a full disk the command itself says what it cannot write
                file.write(event_line(event, time.time()).encode())

        def hear(event: Event) -> None:
            nonlocal message
            if isinstance(event, Failed):
                message = event.message
            elif isinstance(event, Done) or (isinstance(event, Log) and event.stage):
                message = event.summary if isinstance(event, Done) else event.text
            write(event)

        hear(Log("Started." if job.status.worked == 0 else "Goes on."))
        try:
            check_order(jobs.root, job.order.verb, job.order.arguments)
            with heard_by(hear):
                code = command([*job.order.verb.split(), *job.order.arguments])
        except InputError as error:
            code, message = 2, str(error)
            write(Failed(job.order.verb, message, code))
        except SystemExit as stop:  # a wrong option; the parser has said so on stderr
            code = stop.code if isinstance(stop.code, int) else 2
            if code:
                write(Failed(job.order.verb, "an option is wrong; its messages say which", code))
                message = "An option is wrong; the log says which."
    return code, message or (_last_words(job.output) if code == 0 else "")


def _last_words(output: Path) -> str:
    """The last line that was printed, unless it is for programs."""
    sys.stdout.flush()
    try:
        lines = read_end(output, _LAST).decode(errors="replace").strip().splitlines()
    except OSError:
        return ""
    return lines[-1] if lines and not lines[-1].startswith(("{", "[")) else ""


def _redirect(descriptor: int, path: Path) -> None:
    """The process and all its children print into the file from now on."""
    file = own_file(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    os.dup2(file, descriptor)
    os.close(file)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
