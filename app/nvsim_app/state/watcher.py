"""Keeps the document up to date with a thread that checks the project for changes once per second."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Protocol

from PySide6.QtCore import QObject, Signal

from nvsim.errors import InputError
from nvsim_app.state.loading import Contents, ProjectReader

PERIOD = 1.0  # seconds


class ReadableFile(Protocol):
    """A file that provides the contents of a window. It is read once."""

    def contents(self) -> Contents:
        """Reads the file. Raises InputError if it cannot be read."""
        ...


class _ReadingRelay(QObject):
    """Forwards the results of a reading thread to the main thread. After a stop, pending results are dropped, because
    disconnecting a signal does not remove posted events."""

    read = Signal(object)
    failed = Signal(str)
    _posted = Signal(object)

    def __init__(self, parent: QObject | None) -> None:
        super().__init__(parent)
        self._stop = threading.Event()
        self._posted.connect(self._hand_on)

    def _hand_on(self, found: Contents | str) -> None:
        if self._stop.is_set():
            return
        if isinstance(found, str):
            self.failed.emit(found)
        else:
            self.read.emit(found)


class ProjectWatcher(_ReadingRelay):
    """Watches a project. read(Contents) is emitted after every change, failed(str) once for each new error."""

    def __init__(self, path: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._path = path
        self._soon = threading.Event()
        self._reader: ProjectReader | None = None
        self._thread = threading.Thread(target=self._run, name="project watcher", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def refresh(self) -> None:
        """Checks for changes immediately."""
        self._soon.set()

    def stop(self) -> None:
        """Stops, and returns when the thread has ended."""
        self._stop.set()
        self._soon.set()
        reader = self._reader
        if reader is not None:
            reader.interrupt()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        reader: ProjectReader | None = None
        trouble = ""
        while not self._stop.is_set():
            try:
                if reader is None:
                    reader = self._reader = ProjectReader(self._path)
                for contents in reader.updates():
                    if self._stop.is_set():
                        break
                    self._posted.emit(contents)
                trouble = ""
            except InputError as error:
                if str(error) != trouble:
                    trouble = str(error)
                    self._posted.emit(trouble)
            self._soon.wait(PERIOD)
            self._soon.clear()
        self._reader = None
        if reader is not None:
            reader.close()


class FileReader(_ReadingRelay):
    """Reads a file in a thread. Emits read(Contents) once, or failed(str)."""

    def __init__(self, file: ReadableFile, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._file = file
        self._thread = threading.Thread(target=self._run, name="file reader", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        """Stops, and returns when the thread has ended."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()

    def _run(self) -> None:
        try:
            self._posted.emit(self._file.contents())
        except InputError as error:
            self._posted.emit(str(error))
