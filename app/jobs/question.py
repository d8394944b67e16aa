"""Runs a command that answers with one line of JSON in a separate process, without blocking the window."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from PySide6.QtCore import QObject, QProcess, Signal

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
        self._read, self._name = read, name
        self._process: QProcess | None = None

    @property
    def running(self) -> bool:
        return self._process is not None

    def ask(self, words: Sequence[str]) -> None:
        """Runs `nvsim WORDS` in the background and stops a running command."""
        self.stop()
        process = self._process = QProcess(self)
        process.finished.connect(self._on_finished)
        process.errorOccurred.connect(self._on_error)
        process.start(sys.executable, ["-P", "-m", "nvsim.cli.main", *words])

    def stop(self) -> None:
        """Ends the running command without emitting a signal."""
        process, self._process = self._process, None
        if process is not None:
            process.finished.disconnect(self._on_finished)
            process.errorOccurred.disconnect(self._on_error)
            process.kill()
            process.waitForFinished(2000)
            process.deleteLater()

    def _on_finished(self) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        lines = bytes(process.readAllStandardOutput().data()).decode(errors="replace").splitlines()
        said = bytes(process.readAllStandardError().data()).decode(errors="replace").strip()
        process.deleteLater()
        for line in reversed(lines):
            try:
                self.finished.emit(self._read(line))
                return
            except ValueError:
                continue
        why = _failure(lines) or (said.splitlines()[-1] if said else "")
        self.failed.emit(why or f"{self._name} ended without an answer; try again.")

    def _on_error(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart and self._process is not None:
            self._process.deleteLater()
            self._process = None
            self.failed.emit(f"{self._name} could not be started with {sys.executable}; reinstall NVSim.")


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
