"""Runs pieces of work in parallel on this machine, each in its own process.

A child sends its messages through a pipe.
"""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait

from nvsim.cluster.piece import Message, MessageStream, SentFile, Storage, WorkCall, WorkItem, WorkResult
from nvsim.errors import InputError
from nvsim.events import Event, Progress
from nvsim.kernel_threads import cores
from nvsim.processes.messages import receive, send
from nvsim.processes.process import PipedProcess


@dataclass(frozen=True)
class _WorkError:
    sentence: str
    is_ours: bool


class LocalPool:
    """Processes of this machine."""

    remote = False
    storage: Storage = "shared"

    @property
    def machines(self) -> tuple[int, ...]:
        """The cores of this machine."""
        return (cores(),)

    def run(self, pieces: Sequence[WorkItem], begin: Callable[[WorkItem], WorkCall], at_once: int = 0) -> MessageStream:
        """See `Executor.run`. The first child compiles the kernels. The others wait until it has made one step, and
        then read the kernels from the cache."""
        waiting, running = list(pieces), dict[Connection, _WorkerProcess]()
        most = at_once or len(waiting)
        warm = False
        try:
            while waiting or running:
                while waiting and len(running) < most:
                    if running and (waiting[0].exclusive or any(c.piece.exclusive for c in running.values())):
                        break
                    piece = waiting.pop(0)
                    child = _WorkerProcess(piece, begin(piece))
                    if warm or not running:
                        send(child.connection, None)
                    running[child.connection] = child
                for connection in wait(list(running)):
                    assert isinstance(connection, Connection)
                    child = running[connection]
                    message = child.receive()
                    if isinstance(message, _WorkError):
                        raise (RuntimeError if message.is_ours else InputError)(message.sentence)
                    if not warm and isinstance(message, Progress | WorkResult):
                        warm = True
                        for other in running.values():
                            if other is not child:
                                with contextlib.suppress(OSError):  # a dead child is reported when its pipe is read
                                    send(other.connection, None)
                    if isinstance(message, WorkResult):
                        child.end(patience=2.0)
                        del running[connection]
                    yield child.piece, message
        finally:
            for child in running.values():
                child.end()


class _WorkerProcess:
    def __init__(self, piece: WorkItem, order: WorkCall) -> None:
        self.piece = piece
        self._process = PipedProcess(_work, order)
        self.connection = self._process.connection

    def receive(self) -> Message | _WorkError:
        try:
            message: Message | _WorkError = receive(self.connection)
            return message
        except (EOFError, OSError):
            self._process.wait()
            return _WorkError(
                f"the work on {self.piece.label} ended unexpectedly (code {self._process.exit_code}), usually because "
                "memory ran out. Run the same command again to continue, with --at-once 1 to use less memory.",
                False,
            )

    def end(self, patience: float = 0.0) -> None:
        """Stops the process if it has not ended after `patience` seconds."""
        if not self._process.wait(patience):
            self._process.terminate()
            self._process.wait(5)
        self._process.end()


class _PipeCaller:
    """The caller at the other end of a pipe."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def send_event(self, event: Event) -> None:
        send(self._connection, event)

    def send(self, name: str, data: bytes) -> None:
        send(self._connection, SentFile.of(name, data))

    def wait_for_kernels(self) -> None:
        receive(self._connection)


def _work(connection: Connection, order: WorkCall) -> None:
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole process group; the parent handles it
    try:
        send(connection, WorkResult(order.function(_PipeCaller(connection), *order.arguments)))
    except InputError as error:
        send(connection, _WorkError(str(error), False))
    except MemoryError:
        send(connection, _WorkError("out of memory; use --at-once 1, more submaps or fewer Gaussians.", False))
    except (BrokenPipeError, EOFError):
        pass  # the parent has ended
    except Exception:
        send(connection, _WorkError(traceback.format_exc(), True))
