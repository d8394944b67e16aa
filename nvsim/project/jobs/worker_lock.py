"""A lock that tells whether the process of a job is alive. The process holds the lock in the job's folder, and the
kernel releases it when the process ends, even after a crash.

The test uses neither the clock nor the process id. A changed clock, a reused id, or a folder copied from another
machine therefore cannot give a wrong answer.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import signal
import time
from pathlib import Path
from typing import IO

import psutil

from nvsim.files.opening import open_regular

NAME = "worker.lock"
_PATIENCE = 1.0  # seconds
_held: dict[Path, IO[bytes]] = {}  # job folder -> lock file; closing the file releases the lock


def acquire(folder: Path) -> None:
    """Marks this process as the one that runs the job in `folder`, until `release` or its end. Raises OSError, and
    BlockingIOError if another process runs the job."""
    file = open(open_regular(folder / NAME, os.O_RDWR | os.O_CREAT), "rb+")  # noqa: SIM115 (held for the process' life)
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _held[folder] = file
            return
        except BlockingIOError:  # another process tests the lock for microseconds, or runs the job
            if time.monotonic() > end:
                file.close()
                raise
            time.sleep(0.002)


def release(folder: Path) -> None:
    """Releases the lock of the job."""
    file = _held.pop(folder, None)
    if file is not None:
        file.close()


def is_job_running(folder: Path) -> bool:
    """Whether a process runs the job in `folder`."""
    try:
        descriptor = open_regular(folder / NAME)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:  # a file system without locks
        return False
    finally:
        os.close(descriptor)
    return False


def send(folder: Path, pid: int, number: signal.Signals, everything: bool = False) -> bool:
    """Sends a signal to the process that runs the job in `folder`, and with `everything` to all processes that it
    started. Returns whether the signal was sent. `pid` comes from an untrusted file, so it is only used if that process
    has the lock file open."""
    if pid <= 1 or not is_job_running(folder):
        return False
    with contextlib.suppress(OSError, psutil.Error):
        # The handle prevents the id from being reused between the test and the signal.
        handle = os.pidfd_open(pid) if hasattr(os, "pidfd_open") else None
        try:
            if not has_open(pid, folder / NAME):
                return False
            if everything and os.getpgid(pid) == pid:
                os.killpg(pid, number)
            elif handle is not None:
                signal.pidfd_send_signal(handle, number)
            else:
                os.kill(pid, number)
            return True
        finally:
            if handle is not None:
                os.close(handle)
    return False


def has_open(pid: int, path: Path) -> bool:
    """Whether the process has the file at `path` open. False if the process belongs to another user."""
    try:
        wanted = os.lstat(path)
        descriptors = Path(f"/proc/{pid}/fd")
        if descriptors.parent.parent.joinpath("self", "fd").is_dir():
            return any(_leads_to(entry.path, wanted) for entry in os.scandir(descriptors))
        return any(os.path.samefile(file.path, path) for file in psutil.Process(pid).open_files())
    except (OSError, psutil.Error):
        return False


def _leads_to(descriptor: str, wanted: os.stat_result) -> bool:
    try:
        return os.path.samestat(os.stat(descriptor), wanted)
    except OSError:  # the file was closed in the meantime
        return False
