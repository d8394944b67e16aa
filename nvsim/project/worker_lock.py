"""Whether the process that runs a job lives: it holds a lock in the job's folder for its whole life, and the kernel
takes it back when the process dies, however it dies. Neither the clock nor the number of a process decides, so that a
clock that is set, a number that is used again, or a folder that was copied from another machine tells nothing wrong.
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

from nvsim.files.nofollow import open_regular

NAME = "worker.lock"
_PATIENCE = 1.0  # seconds
_held: dict[Path, IO[bytes]] = {}  # by the job's folder; a file that is let go gives its lock back


def hold(folder: Path) -> None:
    """This process runs the job of that folder from now on, until `let_go` or its end. Raises OSError, BlockingIOError
    where another process does."""
    file = open(open_regular(folder / NAME, os.O_RDWR | os.O_CREAT), "rb+")  # noqa: SIM115 (held for the process' life)
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _held[folder] = file
            return
        except BlockingIOError:  # somebody looks, for microseconds, or it is run already
            if time.monotonic() > end:
                file.close()
                raise
            time.sleep(0.002)


def let_go(folder: Path) -> None:
    """This process does not run the job any more."""
    file = _held.pop(folder, None)
    if file is not None:
        file.close()


def is_held(folder: Path) -> bool:
    """Whether a process runs the job of that folder."""
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
    """Sends a signal to the process that runs the job of that folder, with `everything` to all that it started. Returns
    whether it was sent: `pid` comes from a file that anyone may have written, and is believed only where that process
    has the lock's file open."""
    if pid <= 1 or not is_held(folder):
        return False
    with contextlib.suppress(OSError, psutil.Error):
        # Between looking and sending, a handle keeps the number from being used again.
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
    """Whether that process has that very file open. False where it cannot be told: it is another user's."""
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
    except OSError:  # closed meanwhile
        return False
