"""A piece of work inside a process of Ray's: it runs in a thread, and what it tells is yielded as it comes."""

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

from nvsim.cluster.piece import Finished, SentFile
from nvsim.errors import InputError
from nvsim.events import Event, Log

ENDS = frozenset({"finished", "mistake", "memory", "broken"})
"""The words after which nothing comes."""
_GATHER = 0.1  # seconds in which messages are gathered into one
_PATIENCE = 3.0  # seconds that work has to end at its next message


class _Stopped(BaseException):
    """Nobody wants the work any more."""


def work(order: bytes, cores: int) -> Iterator[list[tuple[str, object]]]:
    """Does the pickled `order` with so many threads. Yields "message" and an Event or SentFile, and at the end one of
    "finished" and the Finished, "mistake" and the user's sentence, "memory" where there was not enough of it, "broken"
    and a traceback."""
    driver = _Driver()
    thread = threading.Thread(target=_do, args=(order, cores, driver), daemon=True)
    thread.start()
    try:
        while True:
            found = driver.told()
            if found:
                yield found
            if found and found[-1][0] in ENDS:
                return
    finally:
        driver.stopped.set()
        thread.join(_PATIENCE)
        if thread.is_alive():  # in the middle of something long: the process goes, and what is on disk stays whole
            os._exit(1)


class _Driver:
    """The caller at the other end of the cluster."""

    def __init__(self) -> None:
        self.stopped = threading.Event()
        self._told: queue.SimpleQueue[tuple[str, object]] = queue.SimpleQueue()

    def tell(self, event: Event) -> None:
        self.put("message", event)

    def send(self, name: str, data: bytes) -> None:
        self.put("message", SentFile.of(name, data))

    def ready(self) -> None:
        pass

    def put(self, kind: str, value: object) -> None:
        if self.stopped.is_set():
            raise _Stopped
        self._told.put((kind, value))

    def told(self) -> list[tuple[str, object]]:
        """What was told since the last call; waits for it a moment, and no longer, as a request to stop is heard
        between two calls only."""
        try:
            found = [self._told.get(timeout=_GATHER)]
        except queue.Empty:
            return []
        time.sleep(0.0 if found[0][0] in ENDS else _GATHER)
        while not self._told.empty():
            found.append(self._told.get())
        return found


class _Lines(io.TextIOBase):
    """What libraries print becomes events, line by line."""

    def __init__(self, driver: _Driver) -> None:
        self._driver, self._rest = driver, ""

    def write(self, text: str) -> int:
        *lines, self._rest = (self._rest + text).split("\n")
        for line in lines:
            if line.strip():
                self._driver.tell(Log(line.rstrip()[:1000]))
        return len(text)


def _do(order: bytes, cores: int, driver: _Driver) -> None:
    try:
        import numba

        # Ray tells OpenMP how many cores a task has, and numba nothing.
        numba.set_num_threads(min(cores, int(numba.config.NUMBA_NUM_THREADS)))  # type: ignore[attr-defined]
        function, given = pickle.loads(order)  # writable arrays, unlike those of Ray's store
        lines = _Lines(driver)
        with redirect_stdout(lines), redirect_stderr(lines):
            value = function(driver, *given)
        driver.put("finished", Finished(value))
    except _Stopped:
        pass
    except InputError as error:
        _last(driver, "mistake", str(error))
    except MemoryError:
        _last(driver, "memory", "")
    except Exception:
        _last(driver, "broken", traceback.format_exc())


def _last(driver: _Driver, kind: str, value: str) -> None:
    if not driver.stopped.is_set():
        driver.put(kind, value)
