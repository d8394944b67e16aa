"""The installed networks. A side process lists, tests, and installs them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.processes.serving import Ended
from app.processes.side_process import SideProcess
from app.state.side_work import MODELS, Found, ModelTask


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
        self._process = SideProcess(MODELS, self)
        self._process.ended.connect(self._on_ended)

    def list(self) -> None:
        """Lists all models."""
        self._start(ModelTask(), "Listing the models…")

    def check(self, names: Sequence[str]) -> None:
        """Tests models on an image."""
        self._start(ModelTask(check=tuple(names)), f"{', '.join(names)}: testing…")

    def add(self, paths: Sequence[Path]) -> None:
        """Installs the files of one model."""
        self._start(ModelTask(add=tuple(path.absolute() for path in paths)), "Testing and copying the model…")

    def stop(self) -> None:
        """Ends the current task, and returns after it has ended."""
        self._process.close()
        self.doing = ""

    def _start(self, task: ModelTask, words: str) -> None:
        self._process.open(task)
        self.doing = words
        self.changed.emit()

    def _on_ended(self, end: Ended) -> None:
        self.doing = ""
        found: Found | None = end.value
        if found is not None:
            self.found = found["catalogue"]
            self.checked |= found["checked"]
            if found["added"]:
                self.added = found["added"]
                self.checked.pop(self.added, None)
        self.changed.emit()
        if end.sentence:
            self.failed.emit(end.sentence)
