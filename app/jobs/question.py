"""Runs a command that answers with one line of JSON in a side process."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from PySide6.QtCore import QObject, Signal

from app.processes.child import Program
from app.processes.command import Output, run_command
from app.processes.serving import Ended
from app.processes.side_process import SideProcess
from nvsim.events import Failed, from_json


class Question(QObject):
    """Runs a command and emits its answer: finished(answer), or failed(str) with a sentence, for the last `ask` only.

    read  parses a line of the output; raises ValueError if the line is not an answer
    name  name of the query, used as the subject of error sentences
    """

    finished = Signal(object)
    failed = Signal(str)

    def __init__(self, read: Callable[[str], object], name: str, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._read = read
        self._no_answer = f"{name} ended without an answer; try again."
        cannot = f"{name} could not be started with {sys.executable}"
        self._process = SideProcess(Program(run_command, name, cannot, "reinstall NVSim", self._no_answer), self)
        self._process.ended.connect(self._on_end)

    @property
    def running(self) -> bool:
        return self._process.running

    def ask(self, words: Sequence[str]) -> None:
        """Runs `nvsim WORDS` in the background and stops a running command."""
        self._process.open(tuple(words))

    def stop(self) -> None:
        """Ends the running command without emitting a signal."""
        self._process.close()

    def _on_end(self, end: Ended) -> None:
        if not isinstance(end.value, Output):
            self.failed.emit(end.sentence)
            return
        for line in reversed(end.value.lines):
            try:
                answer = self._read(line)
            except ValueError:
                continue
            self.finished.emit(answer)
            return
        said = end.value.messages[-1] if end.value.messages else self._no_answer
        self.failed.emit(_failure(end.value.lines) or said)


def _failure(lines: Sequence[str]) -> str:
    """The message of the last Failed event, "" if there is none."""
    for line in reversed(lines):
        try:
            event = from_json(line)
        except ValueError:
            continue
        if isinstance(event, Failed):
            return event.message
    return ""
