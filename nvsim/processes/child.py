"""A child process that answers requests, within limits of time and memory.

A library that opens a foreign file may crash, never return, or use all memory. In a child process it cannot harm the
caller, which gets an error message of one sentence. A child also ends at once when the user presses Ctrl-C, even during
a long computation.
"""

from __future__ import annotations

import contextlib
import math
import os
import signal
import threading
import time
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Generic, NoReturn, TypeVar

import psutil

from nvsim.errors import InputError
from nvsim.processes.messages import (
    Answer,
    Notice,
    OutOfMemory,
    ReportedBug,
    ReportedInputError,
    Request,
    receive,
    send,
)
from nvsim.processes.process import PipedProcess
from nvsim.processes.serving import answer_requests

RequestT = TypeVar("RequestT")
AnswerT = TypeVar("AnswerT")
Worker = Callable[[], Callable[[RequestT], AnswerT]]
"""A module-level class whose instances answer requests in `__call__`. The child imports its module when it starts, so
the module should import little. If instances have an attribute `send_event`, the child replaces it with a function.
That function sends its argument to the `hear` callback of `Child.ask`; only the thread that answers may call it."""
_START = 120.0
"""Seconds in which a child must start. A busy machine needs several."""
_LOOK = 0.1  # seconds between two checks of the processor time


@dataclass(frozen=True)
class Limits:
    """The resources that the child may use for one answer.

    seconds    wall-clock time until the answer or the next notice, None for no limit
    memory     bytes in addition to the memory of the child at the start, None for no limit. Only Linux enforces it
    computing  seconds of processor time until the answer or the next notice, None for no limit. This limit stops an
               endless loop early and still allows a slow disk
    """

    seconds: float | None = None
    memory: int | None = None
    computing: float | None = None


class Child(Generic[RequestT, AnswerT]):
    """A child process that runs `worker`. It starts at once, or reuses a process that an earlier Child with this
    worker released. The process ends with `close`, when the Child is garbage-collected, or with this process.

    about  the input of the child, usually a path; error messages begin with it
    then   the advice to the user if the child cannot read the input

    Every method may be called from any thread. Raises InputError if no process can be started.
    """

    def __init__(self, worker: Worker[RequestT, AnswerT], about: str, then: str) -> None:
        self.about, self.then = about, then
        self._worker = worker
        self._lock = threading.Lock()
        with _idle_lock:
            idle = _idle.pop(worker, None)
        self._process = idle if idle is not None and idle.running else _Process(worker)
        self._finalizer = weakref.finalize(self, _Process.end, self._process)

    def ask(
        self, request: RequestT, limits: Limits = Limits(), hear: Callable[[Any], object] = lambda value: None
    ) -> AnswerT:
        """The answer to a request. `hear` is called in this thread with each notice that the worker sends before it.

        Raises InputError if the child refuses the request, crashes, or exceeds the `limits`. After a crash or a
        timeout, the child has ended. Any other exception in the child is a bug in NVSim and raises RuntimeError with
        the traceback. An exception from a signal handler ends the child and is passed on.
        """
        with self._lock:
            try:
                answer = self._process.answer(Request(request, limits.memory), limits, hear)
            except _Ended as error:
                raise InputError(f"{self.about} {error}; {self.then}.") from None
            except BaseException:
                self._process.end()  # an answer may still be in the pipe
                raise
        if isinstance(answer, Answer):
            value: AnswerT = answer.value
            return value
        if isinstance(answer, ReportedInputError):
            raise InputError(answer.sentence)
        if isinstance(answer, OutOfMemory):
            most = f"more than {(limits.memory or 0) / 1e9:.2g} GB of" if limits.memory else "too much"
            raise InputError(f"{self.about} needs {most} memory; {self.then}.")
        raise RuntimeError(answer.traceback)

    def release(self) -> None:
        """Keeps the process for the next Child with this worker, which then starts faster. Only one process per worker
        is kept; any other process ends."""
        with self._lock, _idle_lock:
            self._finalizer.detach()
            if self._process.running and self._worker not in _idle:
                _idle[self._worker] = self._process
            else:
                self._process.end()

    def __enter__(self) -> Child[RequestT, AnswerT]:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def close(self) -> None:
        """Ends the process, also during a request."""
        self._finalizer()


class _Ended(Exception):
    """The reason why a child gives no answer, worded to follow the file name."""


class _Process:
    """The process of a Child."""

    def __init__(self, worker: Worker[Any, Any]) -> None:
        self._ready = False
        self._process = PipedProcess(answer_requests, f"{worker.__module__}:{worker.__qualname__}", hide_output=True)
        self._connection = self._process.connection

    @property
    def running(self) -> bool:
        return not self._connection.closed and self._process.is_owned and self._process.exit_code is None

    def answer(
        self, request: Request, limits: Limits, hear: Callable[[Any], object]
    ) -> Answer | ReportedInputError | OutOfMemory | ReportedBug:
        """Raises _Ended."""
        if not self.running:
            raise _Ended(f"was read by a process that has ended{self._exit_description()}")
        with self._crash_in_words():
            if not self._ready:
                self._receive(Limits(_START))
                self._ready = True
            send(self._connection, request)
        while True:
            with self._crash_in_words():
                found: Answer | Notice | ReportedInputError | OutOfMemory | ReportedBug = self._receive(limits)
            if not isinstance(found, Notice):
                return found
            hear(found.value)

    @contextlib.contextmanager
    def _crash_in_words(self) -> Iterator[None]:
        """Raises _Ended if the process ends in the block."""
        try:
            yield
        except (EOFError, OSError):
            self._process.wait(5)
            words = f"crashed the program that reads it{self._exit_description()}"
            self.end()
            raise _Ended(words) from None

    def _receive(self, limits: Limits) -> Any:
        if limits.computing is None:
            if not self._connection.poll(limits.seconds):
                self._end_late(limits.seconds)
            return receive(self._connection)
        until = time.monotonic() + (math.inf if limits.seconds is None else limits.seconds)
        before = self._processor_seconds()
        while not self._connection.poll(min(_LOOK, max(until - time.monotonic(), 0.0))):
            if time.monotonic() > until:
                self._end_late(limits.seconds)
            if self._processor_seconds() - before > limits.computing:
                self._end_late(limits.computing)
        return receive(self._connection)

    def _processor_seconds(self) -> float:
        """Seconds of processor time that the process has taken."""
        try:
            times = psutil.Process(self._process.id).cpu_times()
        except psutil.Error:
            return 0.0  # the process has ended, and the pipe reports it
        return float(times.user + times.system)

    def _end_late(self, seconds: float | None) -> NoReturn:
        self.end()
        raise _Ended(f"gives no answer within {seconds:.3g} s")

    def _exit_description(self) -> str:
        """How the process ended, in parentheses."""
        code = self._process.exit_code
        if code is None or code >= 0:
            return "" if code is None else f" (code {code})"
        name = signal.Signals(-code).name
        return f" ({name}{', usually because memory ran out' if -code == signal.SIGKILL else ''})"

    def end(self) -> None:
        """See `PipedProcess.end`."""
        self._process.end()


_idle: dict[Worker[Any, Any], _Process] = {}
_idle_lock = threading.Lock()


def _drop_children() -> None:
    """Drops the children in a forked process, because they belong to the parent process."""
    global _idle_lock
    _idle_lock = threading.Lock()
    _idle.clear()


os.register_at_fork(after_in_child=_drop_children)
