"""The networks that are installed, as a process lists, tries and installs them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.state.models_child import Found, ModelsChild
from app.state.waiting import Waiting


class InstalledModels(QObject):
    """changed(): something is under way, or was found; failed(str): a sentence for the user."""

    changed = Signal()
    failed = Signal(str)

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
        self._waiting = Waiting("models", self)
        self._waiting.ended.connect(self._on_ended)

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
