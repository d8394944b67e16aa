"""The installed networks. A child process lists, tests, and installs them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.state.models_child import Found, ModelsChild
from app.state.waiting import Waiting


class InstalledModels(QObject):
    """The catalog of networks.

    changed()     a task started or ended
    failed(str)   a sentence for the user
    """

    changed = Signal()
    failed = Signal(str)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.found: Found = {}
        """The last catalog, {} if it was not listed yet."""
        self.checked: Found = {}
        """Result of the last test of each model, by name."""
        self.added = ""
        """The name of the last installed model."""
        self.doing = ""
        """The current task as text, "" if there is none."""
        self._waiting = Waiting("models", self)
        self._waiting.ended.connect(self._on_ended)

    def list(self) -> None:
        """Lists all models."""
        self._start(ModelsChild(), "Listing the models…")

    def check(self, names: Sequence[str]) -> None:
        """Tests models on an image."""
        self._start(ModelsChild(check=names), f"{', '.join(names)}: testing…")

    def add(self, paths: Sequence[Path]) -> None:
        """Installs the files of one model."""
        self._start(ModelsChild(add=paths), "Testing and copying the model…")

    def stop(self) -> None:
        """Ends the current task, and returns after it has ended."""
        self._waiting.stop()
        self.doing = ""

    def _start(self, child: ModelsChild, words: str) -> None:
        self._waiting.start(child)
        self.doing = words
        self.changed.emit()

    def _on_ended(self, found: Found | None, trouble: str) -> None:
        self.doing = ""
        if found is not None:
            self.found = found["catalogue"]
            self.checked |= found["checked"]
            if found["added"]:
                self.added = found["added"]
                self.checked.pop(self.added, None)
        self.changed.emit()
        if trouble:
            self.failed.emit(trouble)
