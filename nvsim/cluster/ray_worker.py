"""Runs a piece of work in a process of Ray: the work runs in a thread, and its messages are yielded as they come."""

from __future__ import annotations

import io
import os
import pickle
import queue
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout

from nvsim.cluster.piece import SentFile, WorkResult
from nvsim.errors import InputError
from nvsim.events import Event, Log

ENDS = frozenset({"finished", "mistake", "memory", "broken"})
"""Kinds of the last message."""
_GATHER = 0.1  # seconds in which messages are collected into one
_PATIENCE = 3.0  # seconds in which the work must end; it stops at its next message


class _WorkStopped(BaseException):
    """The caller has stopped the work."""


def run_work_call(order: bytes, cores: int) -> Iterator[list[tuple[str, object]]]:
    """Runs the pickled `order` with `cores` threads.

    Yields lists of pairs: "message" and an Event or SentFile. The last pair is "finished" and a Finished, "mistake" and
    a message for the user, "memory" if memory ran out, or "broken" and a traceback.
    """
    driver = _ClusterCaller()
    thread = threading.Thread(target=_do, args=(order, cores, driver), daemon=True)
    thread.start()
    try:
        while True:
            found = driver.messages()
            if found:
                yield found
            if found and found[-1][0] in ENDS:
                return
    finally:
        driver.stopped.set()
        thread.join(_PATIENCE)
        if thread.is_alive():  # in a long computation: ending the process is safe, since all files are complete
            os._exit(1)


class _ClusterCaller:
    """The caller at the other end of the cluster connection."""

    def __init__(self) -> None:
        self.stopped = threading.Event()
        self._messages: queue.SimpleQueue[tuple[str, object]] = queue.SimpleQueue()

    def send_event(self, event: Event) -> None:
        self.put_message("message", event)

    def send(self, name: str, data: bytes) -> None:
        self.put_message("message", SentFile.of(name, data))

    def wait_for_kernels(self) -> None:
        pass

    def put_message(self, kind: str, value: object) -> None:
        if self.stopped.is_set():
            raise _WorkStopped
        self._messages.put((kind, value))

    def messages(self) -> list[tuple[str, object]]:
        """The messages since the last call. Waits only briefly, because requests to stop are handled between two
        calls."""
        try:
            found = [self._messages.get(timeout=_GATHER)]
        except queue.Empty:
            return []
        time.sleep(0.0 if found[0][0] in ENDS else _GATHER)
        while not self._messages.empty():
            found.append(self._messages.get())
        return found


class _LineForwarder(io.TextIOBase):
    """Converts the printed lines of libraries to events."""

    def __init__(self, driver: _ClusterCaller) -> None:
        self._driver, self._rest = driver, ""

    def write(self, text: str) -> int:
        *lines, self._rest = (self._rest + text).split("\n")
        for line in lines:
            if line.strip():
                self._driver.send_event(Log(line.rstrip()[:1000]))
        return len(text)


def _do(order: bytes, cores: int, driver: _ClusterCaller) -> None:
    try:
        import numba

        # Ray limits the threads of OpenMP to the cores of the task, but not those of numba.
        numba.set_num_threads(min(cores, int(numba.config.NUMBA_NUM_THREADS)))  # type: ignore[attr-defined]
        function, given = pickle.loads(order)  # writable arrays, unlike those of Ray's store
        lines = _LineForwarder(driver)
        with redirect_stdout(lines), redirect_stderr(lines):
            value = function(driver, *given)
        driver.put_message("finished", WorkResult(value))
    except _WorkStopped:
        pass
    except InputError as error:
        _last(driver, "mistake", str(error))
    except MemoryError:
        _last(driver, "memory", "")
    except Exception:
        _last(driver, "broken", traceback.format_exc())


def _last(driver: _ClusterCaller, kind: str, value: str) -> None:
    if not driver.stopped.is_set():
        driver.put_message(kind, value)
