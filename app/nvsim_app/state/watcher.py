"""Keeps the document up to date with a thread that checks the project for changes once per second."""

from __future__ import annotations

import threading
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from nvsim.errors import InputError
from nvsim_app.state.loading import Contents, ProjectReader

PERIOD = 1.0  # seconds


class ProjectWatcher(QObject):
    """Watches a project. read(Contents) is emitted after every change, failed(str) once for each new error.

    After a stop, pending results are dropped, because disconnecting a signal does not remove posted events.
    """

    read = Signal(object)
    failed = Signal(str)
    _posted = Signal(object)  # from the thread: the contents, or the sentence of an error

    def __init__(self, path: Path, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._path = path
        self._stop = threading.Event()
        self._posted.connect(self._hand_on)
        self._soon = threading.Event()
        self._reader: ProjectReader | None = None
        self._thread = threading.Thread(target=self._run, name="project watcher", daemon=True)

    def _hand_on(self, found: Contents | str) -> None:
        if self._stop.is_set():
            return
        if isinstance(found, str):
            self.failed.emit(found)
        else:
            self.read.emit(found)

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
