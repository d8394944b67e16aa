"""The history of edits, newest step at the bottom. A click goes to a step."""

from __future__ import annotations

import time
from dataclasses import dataclass

from PySide6.QtGui import QFont
from PySide6.QtWidgets import QListView, QWidget

from nvsim.graph.history import Step
from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.table import Column, TableModel
from nvsim_app.look.theme import type_font
from nvsim_app.look.widgets import named
from nvsim_app.state.document import Document


@dataclass(frozen=True, eq=False)
class _Row:
    index: int
    step: Step


class HistoryPanel(QWidget):
    """The list of steps; the first one is the opened graph.

    Steps after the current one are gray. Steps that come from outside this window are in italics.
    """

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._current = -1  # index of the current step
        column = Column("Step", self._text, about=_about, ink=self._ink, font=self._font)
        # Only changed rows are added and removed, because a history can have thousands of steps.
        self.model: TableModel[_Row] = TableModel((column,), self, key=lambda row: id(row.step), in_place=True)
        self.list = named(QListView(self, uniformItemSizes=True), "History of edits", "Click a step to go to it")
        self.list.setModel(self.model)
        self.list.setFrameShape(self.list.Shape.NoFrame)
        self.list.clicked.connect(lambda index: document.editing.go_to(index.row()))
        document.editing.stepsChanged.connect(self._show_steps)
        vbox(self.list, on=self, margins=0)
        self._show_steps()

    def _text(self, row: _Row) -> str:
        return short_ids(self._document.graph, row.step.text)

    def _ink(self, row: _Row) -> str:
        return colors.text("quiet") if row.index > self._current else ""

    def _font(self, row: _Row) -> QFont | None:
        if row.index != self._current and not row.step.outside:
            return None
        font = type_font(bold=row.index == self._current)
        font.setItalic(row.step.outside)
        return font

    def _show_steps(self) -> None:
        history = self._document.editing.history
        steps, self._current = ((), -1) if history is None else (history.steps, history.index)
        self.model.show([_Row(index, step) for index, step in enumerate(steps)])
        if history is not None:
            index = self.model.index(self._current, 0)
            self.list.setCurrentIndex(index)
            self.list.scrollTo(index)


def _about(row: _Row) -> str:
    when = time.strftime("%d %b %H:%M:%S", time.localtime(row.step.when))
    return f"{when}, not edited in this window" if row.step.outside else when
