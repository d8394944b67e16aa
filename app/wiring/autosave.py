"""Saves the graph automatically, after the time that the preferences set."""

from __future__ import annotations

from PySide6.QtCore import QTimer

from app.state.graph_reasons import can_save
from app.wiring.part import Part, WindowContext

_KEY = "autosave_minutes"


class AutosavePart(Part):
    """Writes the graph for other programs. Edits survive a crash without it, because the journal has them."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self.timer = QTimer(self, singleShot=True)
        self.timer.timeout.connect(self._save)
        context.preferences.changed.connect(self._on_preference)
        context.document.editing.stepsChanged.connect(self._follow)

    def _on_preference(self, key: str) -> None:
        if key == _KEY:
            self.timer.stop()
            self._follow()

    def _follow(self) -> None:
        """Starts the timer at the first unsaved edit."""
        minutes = self.context.preferences.number(_KEY)
        if not minutes or can_save(self.context.document) is not None:
            self.timer.stop()
        elif not self.timer.isActive():
            self.timer.start(round(60_000 * minutes))

    def _save(self) -> None:
        if can_save(self.context.document) is None:
            self.context.document.editing.save()
