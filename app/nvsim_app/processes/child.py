"""One run of a side process, and the thread that starts it and reads its messages. Does not use Qt."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from nvsim.errors import InputError
from nvsim.processes.messages import receive, send
from nvsim.processes.process import PipedProcess
from nvsim_app.processes.serving import EndMessage, Requests, serve

RESTARTS = 2  # maximum number of restarts of a process that answers requests
_LEAVING = 5.0  # seconds in which a process must end after its last message


@dataclass(frozen=True)
class ChildProgram:
    """What a side process runs.

    function      a module-level function that gets the requests of the window and the source. It returns the result of
                  the process. A process that answers requests never returns, because `requests.take` ends it. Any: the
                  source
    name          the name of the process and of its thread
    failure_text  the beginning of the sentence if the work fails
    advice        what the user can do if the process cannot be started
    crash_text    the sentence if the process crashes and is not started again
    restarts      how often a process that crashed is started again
    nice          the lower priority of the process; the window has priority
    memory        bytes that the work may use, None for no limit. Only Linux enforces it
    """

    function: Callable[[Requests, Any], object]
    name: str
    failure_text: str
    advice: str = "close other programs"
    crash_text: str = ""
    restarts: int = 0
    nice: int = 5
    memory: int | None = None


class Child:
    """A process that runs `program` on `source`, which must be picklable. It starts at once, in a thread, because that
    takes about 70 ms.

    `heard` is called in the reading thread with this object and each message of `serving`. The last one is Ended,
    unless `kill` was called.
    """

    def __init__(
        self,
        program: ChildProgram,
        source: object,
        heard: Callable[[Child, object], object] = lambda child, message: None,
    ) -> None:
        self._program, self._source, self._heard = program, source, heard
        self._process: PipedProcess | None = None
        self._running = False
        self._killed = False
        self._ended: EndMessage | None = None
        self._thread = threading.Thread(target=self._run, name=f"{program.name} link", daemon=True)
        self._thread.start()

    @property
    def process_id(self) -> int | None:
        """None before the start and after the end."""
        process = self._process
        return process.id if process is not None and self._running else None

    def send(self, number: int, request: object) -> None:
        """Sends a request that can be pickled. Raises OSError if the process has ended."""
        process = self._process
        if process is None:
            raise BrokenPipeError
        send(process.connection, (number, request))

    def result(self) -> Any:
        """Waits for the result of the work. None after `kill`. Raises InputError with the reason if the work failed."""
        self._thread.join()
        if self._killed or self._ended is None:
            return None
        if self._ended.sentence:
            raise InputError(self._ended.sentence)
        return self._ended.value

    def kill(self) -> None:
        """Ends the process without waiting for its end. Can be called from any thread, and more than once."""
        self._killed = True
        process = self._process
        if process is not None:
            process.kill()

    def end(self) -> None:
        """Ends the process, and returns after it has ended."""
        self.kill()
        self._thread.join()
        if self._process is not None:
            self._process.end()  # only now: another file could get the number of the pipe while `send` uses it

    def _run(self) -> None:
        program = self._program
        arguments = program.function, self._source, program.failure_text, program.nice, program.memory
        try:
            process = PipedProcess(serve, *arguments)
        except Exception as error:  # no process can be started, or the source cannot be pickled
            reason = str(error).rstrip(".")
            self._end_with(EndMessage(sentence=f"{program.failure_text}: {reason}; {program.advice}."))
            return
        self._process, self._running = process, True
        if self._killed:
            process.kill()
        try:
            self._read(process.connection)
            process.wait(_LEAVING)
        finally:
            self._running = False
            process.kill()
            process.wait()
        if self._ended is None:
            words = program.crash_text or f"{program.failure_text}: its process ended with code {process.exit_code}."
            self._end_with(EndMessage(sentence=words, crashed=True))

    def _read(self, connection: Connection) -> None:
        try:
            while self._ended is None:
                message = receive(connection)
                if isinstance(message, EndMessage):
                    self._end_with(message)
                else:
                    self._heard(self, message)
        except (EOFError, OSError):
            pass

    def _end_with(self, ended: EndMessage) -> None:
        self._ended = ended
        if not self._killed:
            self._heard(self, ended)
