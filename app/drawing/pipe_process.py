"""One run of a child process that the window talks to through a pipe. Does not use Qt."""

from __future__ import annotations

import multiprocessing
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

RESTARTS = 2  # maximum number of restarts of a process that dies


class PipeProcess:
    """A child process that runs `serve(connection, source)`, and the thread that starts it and reads its messages.

    Starting a process takes about 70 ms, which would block the window's main thread. `heard` is called in the reading
    thread with each message, and with None when the process ends. If the process cannot be started, `heard` gets the
    OSError or RuntimeError.
    """

    def __init__(
        self,
        serve: Callable[[Connection, Any], None],  # Any: the source that `serve` accepts
        source: object,
        name: str,
        heard: Callable[[object], None],
    ) -> None:
        # Spawn, because a fork of a process with threads and a window is not safe.
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
        """Ends the process, and returns when the process and the thread have ended."""
        self._started.wait()
        if self.process is not None:
            self.process.terminate()
            self.process.join()
            self.process.close()
            self.process = None
        self._thread.join()  # the pipe is closed, so the thread ends
        self.connection.close()
