"""One run of a process that the window talks with through a pipe. Knows no Qt."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

RESTARTS = 2  # a process that dies more often than this stays dead


class Life:
    """The process, whose main function is `serve(connection, source)`, and the thread that starts it and reads from it:
    starting costs some 70 ms of imports and forking, which the window's own thread must not spend.

    `heard` is called in that thread with every message, with None when the process has ended, and with the OSError or
    RuntimeError where it could not be started.
    """

    def __init__(
        self,
        serve: Callable[[Connection, Any], None],  # Any: what `serve` takes
        source: object,
        name: str,
        heard: Callable[[object], None],
    ) -> None:
        # Spawned: a fork of a process with threads and a window is not safe.
        self._context = multiprocessing.get_context("spawn")
        self.connection, self._theirs = self._context.Pipe()
        self._serve, self._source, self._name, self._heard = serve, source, name, heard
        self._started = threading.Event()
        self.process: BaseProcess | None = None
        self._thread = threading.Thread(target=self._run, name=f"{name} link", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            process = self._context.Process(
                target=self._serve, args=(self._theirs, self._source), name=f"nvsim {self._name}", daemon=True
            )
            process.start()
            self.process = process
        except (OSError, RuntimeError) as error:
            self._heard(error)
            return
        finally:
            self._theirs.close()
            self._started.set()
        try:
            while True:
                self._heard(self.connection.recv())
        except (EOFError, OSError):
            self._heard(None)

    def end(self) -> None:
        """Returns when process and thread are gone."""
        self._started.wait()
        if self.process is not None:
            self.process.terminate()
            self.process.join()
            self.process.close()
            self.process = None
        self._thread.join()  # the process held the other end, so reading has ended
        self.connection.close()
