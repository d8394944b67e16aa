"""Describes the last edit in the status bar, with the key that undoes or redoes it."""

from __future__ import annotations

from PySide6.QtCore import QTimer

from app.layers.labels import short_ids
from app.look.plain_text import plain
from app.state.step_words import past
from app.wiring.checking import CheckPart
from app.wiring.part import Part, WindowContext
from nvsim.graph.history import Step
from nvsim.graph.types import NavGraph

SHOWN = 8000  # milliseconds until the status bar shows the hint of the mode again


class FeedbackPart(Part):
    """Describes edits only, because the views already show the selection."""

    def __init__(self, context: WindowContext) -> None:
        super().__init__(context)
        self._steps: tuple[Step, ...] = ()
        self._index = 0
        self._last_message = ""
        self._over = QTimer(self, singleShot=True, interval=SHOWN)
        self._over.timeout.connect(self._hint)
        context.document.editing.stepsChanged.connect(self._on_steps)
        context.document.projectChanged.connect(self._look)
        context.document.editing.notified.connect(self._look)

    def _look(self, _: object = None) -> None:
        """Records the current history without reporting it."""
        history = self.context.document.editing.history
        self._steps, self._index = ((), 0) if history is None else (history.steps, history.index)

    def _on_steps(self) -> None:
        steps, index = self._steps, self._index
        self._look()
        if not self._steps or not steps or self._steps[0] is not steps[0]:
            return  # another graph
        words, graph = "", self.context.document.graph
        undoes, redoes = self._key("undo", "undoes"), self._key("redo", "redoes")
        if index < self._index and self._steps[index + 1 : self._index + 1] == steps[index + 1 : self._index + 1]:
            words = _said(graph, "Redone", self._steps[index + 1 : self._index + 1], undoes)
        elif index < self._index or (index == self._index and self._steps[index] is not steps[index]):
            words = _said(graph, "", self._steps[self._index : self._index + 1], undoes)
        elif index > self._index:
            words = _said(graph, "Undone", steps[self._index + 1 : index + 1], redoes)
        if words and not self.context.part(CheckPart).reviewing:
            self._last_message = words
            self.context.modes.said.emit(words)
            self._over.start()
        elif not words:
            self._hint()  # the key now undoes another step, such as a selection

    def _key(self, id: str, does: str) -> str:
        """For example "Ctrl+Z undoes"; "" if the command has no shortcut."""
        keys = self.context.window.actions_table.keys(id)
        return f" · {keys} {does}" if keys else ""

    def _hint(self) -> None:
        if self.context.window.statusBar().currentMessage() == plain(self._last_message):
            self.context.modes.said.emit(self.context.modes.current.hint)


def _said(graph: NavGraph | None, what: str, steps: tuple[Step, ...], key: str) -> str:
    """One sentence about the edits among these steps; "" if there are none."""
    edits = [short_ids(graph, step.text) for step in steps if step.edit]
    if not edits:
        return ""
    more = f" and {len(edits) - 1} more" if len(edits) > 1 else ""
    text = f"{what}: {edits[-1][0].lower()}{edits[-1][1:]}" if what else past(edits[-1])
    return f"{text}{more}{key}"
