"""The child's side of `nvsim.processes.process`.

`python -P -m nvsim.processes.serving CONNECTION LIFE` runs the function that it receives, until the caller ends.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import resource
import signal
import sys
import threading
import traceback
from multiprocessing.connection import Connection
from typing import Any

from nvsim.errors import InputError
from nvsim.processes.messages import Answer, Notice, OutOfMemory, ReportedBug, ReportedInputError, receive, send

_F_SETSIG = 10  # Linux constant of fcntl that Python does not define


def main(connection: int, life: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches the whole process group and ends any computation
    end_with(life)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    pipe = Connection(connection)
    with contextlib.suppress(EOFError, OSError):  # raised when the caller has ended
        function, arguments = receive(pipe)
        function(pipe, *arguments)


def answer_requests(pipe: Connection, worker: str) -> None:
    """Answers the requests of a `nvsim.processes.child.Child`. `worker` names its class as MODULE:NAME."""
    answer: Any = None
    try:
        module, _, name = worker.partition(":")
        answer = getattr(importlib.import_module(module), name)()
        if hasattr(answer, "send_event"):
            answer.send_event = lambda value: send(pipe, Notice(value))
        send(pipe, Answer(None))
    except Exception:
        send(pipe, Answer(None))
        receive(pipe)
        send(pipe, ReportedBug(traceback.format_exc()))
        return
    while True:
        request = receive(pipe)
        limit_memory(request.memory)
        send(pipe, _answer_or_error(answer, request.value))


def _answer_or_error(answer: Any, request: Any) -> Answer | ReportedInputError | OutOfMemory | ReportedBug:
    try:
        return Answer(answer(request))
    except InputError as error:
        return OutOfMemory() if isinstance(error.__cause__, MemoryError) else ReportedInputError(str(error))
    except MemoryError:
        return OutOfMemory()
    except Exception:
        return ReportedBug(traceback.format_exc())
    finally:
        limit_memory(None)  # no limit applies while the answer is sent


def limit_memory(more: int | None) -> None:
    """Limits this process to `more` bytes in addition to its current memory; None removes the limit. Memory-mapped
    files do not count. Has no effect if the system does not report the memory of a process."""
    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    soft = hard
    if more is not None and (held := _private_memory()) is not None:
        soft = held + more if hard == resource.RLIM_INFINITY else min(held + more, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _private_memory() -> int | None:
    """Bytes of private memory that count toward RLIMIT_DATA."""
    with contextlib.suppress(OSError), open("/proc/self/status", encoding="ascii") as status:
        for line in status:
            if line.startswith("VmData:"):
                return int(line.split()[1]) << 10
    return None


def end_with(life: int) -> None:
    """Ends this process when the other end of the pipe `life` is closed, for example because its owner ended. On Linux
    this works even while a library computes and blocks all other Python threads."""
    if sys.platform == "linux":
        import fcntl

        fcntl.fcntl(life, fcntl.F_SETOWN, os.getpid())
        fcntl.fcntl(life, _F_SETSIG, signal.SIGKILL)
        fcntl.fcntl(life, fcntl.F_SETFL, fcntl.fcntl(life, fcntl.F_GETFL) | os.O_ASYNC)
    threading.Thread(target=_wait_for_end, args=(life,), daemon=True).start()


def _wait_for_end(life: int) -> None:
    os.read(life, 1)
    os._exit(1)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
