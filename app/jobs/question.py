"""A command that answers with one line of JSON, asked in a process of its own while the window goes on."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from PySide6.QtCore import QObject, QProcess, Signal

from nvsim.events import Failed, from_json


class Question(QObject):
    """finished(answer), or failed(str) with a sentence; of the last `ask` only.

    read  makes the answer of a line; it raises ValueError where the line is none
    name  of what is asked, as a sentence begins with it
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
        """Runs `nvsim WORDS` in the background, in place of what is running."""
        self.stop()
        process = self._process = QProcess(self)
        process.finished.connect(self._on_finished)
        process.errorOccurred.connect(self._on_error)
        process.start(sys.executable, ["-P", "-m", "nvsim.cli.main", *words])

    def stop(self) -> None:
        """Ends it; nothing is told about it."""
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
        self.failed.emit(why or f"{self._name} ended without an answer; try it again.")

    def _on_error(self, error: QProcess.ProcessError) -> None:
        if error == QProcess.ProcessError.FailedToStart and self._process is not None:
            self._process.deleteLater()
            self._process = None
            self.failed.emit(f"{self._name} could not be started with {sys.executable}; is NVSim installed whole?")


def _failure(lines: Sequence[str]) -> str:
    """The sentence of the event that ends a command, "" where there is none."""
    for line in reversed(lines):
        try:
            event = from_json(line)
        except ValueError:
            continue
        if isinstance(event, Failed):
            return event.message
    return ""
