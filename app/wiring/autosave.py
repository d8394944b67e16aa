"""Saves the graph by itself, so long after an edit as the preferences say."""

from __future__ import annotations

from PySide6.QtCore import QTimer

from app.state.graph_reasons import can_save
from app.wiring.part import Part, Workspace

_KEY = "autosave_minutes"


class AutosavePart(Part):
    """Any edit survives a crash in the journal; this writes the graph itself, for others to read."""

    def __init__(self, workspace: Workspace) -> None:
        super().__init__(workspace)
        self.timer = QTimer(self, singleShot=True)
        self.timer.timeout.connect(self._save)
        workspace.preferences.changed.connect(self._on_preference)
        workspace.document.editing.stepsChanged.connect(self._follow)

    def _on_preference(self, key: str) -> None:
        if key == _KEY:
            self.timer.stop()
            self._follow()

    def _follow(self) -> None:
        """The time runs from the first edit that is not saved."""
        minutes = self.workspace.preferences.number(_KEY)
        if not minutes or can_save(self.workspace.document) is not None:
            self.timer.stop()
        elif not self.timer.isActive():
            self.timer.start(round(60_000 * minutes))

    def _save(self) -> None:
        if can_save(self.workspace.document) is None:
            self.workspace.document.editing.save()
