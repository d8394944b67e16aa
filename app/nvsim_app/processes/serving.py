"""The side process's end of its pipe: receives requests, answers them, and reports the end. Runs commands of NVSim.
Does not use Qt."""

from __future__ import annotations

import contextlib
import io
import os
import threading
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from nvsim.errors import InputError, value_text
from nvsim.processes.messages import receive, send
from nvsim.processes.serving import limit_memory

_LONGEST = 160  # characters of an unexpected error that are part of a sentence
OPENED = 0
"""The number in the first Free message: the process has opened its source."""


@dataclass(frozen=True)
class ReadyMessage:
    """The process can receive the next request. number: the last request that it received, OPENED if there is none."""

    number: int


@dataclass(frozen=True, eq=False)
class Answer:
    """An answer to a request, None if the request needs none. more: whether further answers to it will come."""

    number: int
    value: object
    more: bool


@dataclass(frozen=True, eq=False)
class Notice:
    """A message that answers no request."""

    value: object


@dataclass(frozen=True, eq=False)
class EndMessage:
    """The last message of a process: the result of its work, or why it failed.

    value     the result of a process that succeeded
    sentence  why the process failed, for the user; "" if it succeeded
    trace     the traceback of an unexpected error
    crashed   whether the process ended without a word, so that it may succeed if it is started again
    """

    value: Any = None
    sentence: str = ""
    trace: str = ""
    crashed: bool = False


class WindowClosed(BaseException):
    """The window has ended. Like SystemExit, this is no error of the work."""


class Requests:
    """The requests of the window, and the connection back to it. Answers may be sent from any thread."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._number = OPENED  # the last received request
        self._freed = -1  # the last request after which the window may send another one

    @property
    def waiting(self) -> bool:
        """Whether `wait_for_request` returns at once."""
        self._send_ready()
        return self._connection.poll()

    def wait_for_request(self) -> tuple[int, Any]:
        """Waits for the next request. Returns its number, which its answers need, and the request. Raises
        WindowClosed."""
        self._send_ready()
        try:
            self._number, request = receive(self._connection)
        except (EOFError, OSError):
            raise WindowClosed from None
        return self._number, request

    def answer(self, number: int, value: object, more: bool = False) -> None:
        """Answers a request; with `more`, further answers to it will come. Raises WindowClosed."""
        self.send(Answer(number, value, more))
        if number == self._number and not more:
            self._freed = number

    def finish(self, number: int) -> None:
        """Ends a request that needs no further answer. Raises WindowClosed."""
        self.answer(number, None)

    def send_notice(self, value: object) -> None:
        """Sends a message that answers no request. Raises WindowClosed."""
        self.send(Notice(value))

    def send(self, message: object) -> None:
        """Sends a message of the protocol. Raises WindowClosed."""
        try:
            with self._lock:
                send(self._connection, message)
        except OSError:
            raise WindowClosed from None

    def _send_ready(self) -> None:
        if self._freed != self._number:
            self._freed = self._number
            self.send(ReadyMessage(self._number))


def serve(
    pipe: Connection,
    work: Callable[[Requests, Any], object],
    source: object,
    cannot: str,
    nice: int,
    memory: int | None,
) -> None:
    """The function of a side process: runs `work` and sends its result or its error; see `child.ChildProgram`."""
    if hasattr(os, "nice"):
        os.nice(nice)
    requests = Requests(pipe)
    try:
        limit_memory(memory)
        try:
            ended = EndMessage(work(requests, source))
        except InputError as error:
            ended = EndMessage(sentence=str(error))
        except MemoryError:
            most = "too much" if memory is None else f"more than {memory / 1e9:.2g} GB of"
            ended = EndMessage(sentence=f"{cannot}: it needs {most} memory.")
        finally:
            limit_memory(None)
        requests.send(ended)
    except WindowClosed:
        pass
    except Exception as error:
        traceback.print_exc()
        requests.send(EndMessage(sentence=f"{cannot}: {short_reason(error)}", trace=traceback.format_exc()))


def short_reason(error: Exception) -> str:
    """Why something failed, as the end of a sentence: the message of an InputError, or the first line of an unexpected
    error. Messages of compilers have many lines, some with a traceback; that of a KeyError is only a key."""
    if isinstance(error, InputError):
        return str(error)
    line = next(iter(str(error).strip().splitlines()), "").strip()
    words = "" if isinstance(error, KeyError) else value_text(line, _LONGEST).removesuffix(".")
    return f"unexpected error ({words or type(error).__name__})."


@dataclass(frozen=True)
class CommandOutput:
    """The lines that a command prints: its result, and its messages."""

    lines: tuple[str, ...]
    messages: tuple[str, ...]


def run_command(requests: Requests, words: Sequence[str]) -> CommandOutput:
    """Runs `nvsim WORDS`."""
    from nvsim.cli.main import main

    result, messages = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(result), contextlib.redirect_stderr(messages), contextlib.suppress(SystemExit):
        main(words)
    return CommandOutput(tuple(result.getvalue().splitlines()), tuple(messages.getvalue().strip().splitlines()))
