"""Work that the tests of the cluster give to its workers, which import it by name."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

from nvsim.cluster.piece import Caller, StorageNotShared
from nvsim.errors import InputError
from nvsim.events import Log, Progress


def add(caller: Caller, a: int, b: int) -> tuple[int, int, int]:
    """The sum, the threads of numba and the process."""
    import numba

    print("said aside", file=sys.stderr)
    caller.send_event(Progress("sums", 1, 1))
    return a + b, numba.get_num_threads(), os.getpid()


def refuse(caller: Caller) -> None:
    raise InputError("There is no such sum; ask for another.")


def break_down(caller: Caller) -> None:
    raise ZeroDivisionError("ours")


def need_memory(caller: Caller, needed: int) -> int:
    """Fails until a task has so many bytes; returns how many it has."""
    import ray

    has = int(ray.get_runtime_context().get_assigned_resources()["memory"])
    if has < needed:
        raise MemoryError
    return has


def die(caller: Caller, folder: Path, times: int, further: bool) -> int:
    """Is killed so many times, each time a step further on where it says so."""
    tried = len(list(folder.iterdir()))
    (folder / str(tried)).touch()
    caller.send_event(Progress("sums", tried + 1 if further else 1, 100))
    time.sleep(0.4)  # until it is heard
    if tried < times:
        os.kill(os.getpid(), signal.SIGKILL)
    return tried


def send_back(caller: Caller, path: Path, see: bool) -> str | StorageNotShared:
    if not see:
        return StorageNotShared("A machine does not see the files")
    caller.send("a file", path.read_bytes())
    return "sent"


def count_slowly(caller: Caller, path: Path) -> None:
    """Writes where it is for a minute."""
    for i in range(600):
        path.write_text(str(i))
        caller.send_event(Log(str(i), "sums"))
        time.sleep(0.1)
