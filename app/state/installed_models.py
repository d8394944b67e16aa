"""The networks that are installed, as a process lists, tries and installs them."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.state.models_child import Found, ModelsChild
from nvsim.errors import InputError


class InstalledModels(QObject):
    """changed(): something is under way, or was found; failed(str): a sentence for the user."""

    changed = Signal()
    failed = Signal(str)
    _ended = Signal(int, object, str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.found: Found = {}
        """The last catalogue, {} before the first."""
        self.checked: Found = {}
        """What each model answered when it was last tried, by name."""
        self.added = ""
        """The name of the model that was installed last."""
        self.doing = ""
        """What is under way, in words."""
        self._child: ModelsChild | None = None
        self._thread: threading.Thread | None = None
        self._number = 0
        self._ended.connect(self._on_ended)

    def list(self) -> None:
        self._start(ModelsChild(), "The models are listed…")

    def check(self, names: Sequence[str]) -> None:
        """Opens models and shows each an image."""
        self._start(ModelsChild(check=names), f"{', '.join(names)} is tried…")

    def add(self, paths: Sequence[Path]) -> None:
        """Installs the files of one model."""
        self._start(ModelsChild(add=paths), "The model is opened and copied…")

    def stop(self) -> None:
        """Nothing runs when this returns."""
        self._number += 1
        if self._child is not None:
            self._child.kill()
        if self._thread is not None:
            self._thread.join()
        self._child, self._thread, self.doing = None, None, ""

    def _start(self, child: ModelsChild, words: str) -> None:
        self.stop()
        self._child, self.doing = child, words
        number = self._number

        def work() -> None:
            try:
                self._ended.emit(number, child.result(), "")
            except InputError as error:
                self._ended.emit(number, None, str(error))

        self._thread = threading.Thread(target=work, name="models", daemon=True)
        self._thread.start()
        self.changed.emit()

    def _on_ended(self, number: int, found: Found | None, trouble: str) -> None:
        if number != self._number:
            return
        if self._thread is not None:
            self._thread.join()
        self._child, self._thread, self.doing = None, None, ""
        if found is not None:
            self.found = found["catalogue"]
            self.checked |= found["checked"]
            if found["added"]:
                self.added = found["added"]
                self.checked.pop(self.added, None)
        self.changed.emit()
        if trouble:
            self.failed.emit(trouble)
