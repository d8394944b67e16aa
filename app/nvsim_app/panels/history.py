"""The history of edits, newest step at the bottom. A click goes to a step."""

from __future__ import annotations

import time
from typing import Any

from PySide6.QtCore import QAbstractListModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QListView, QWidget

from nvsim.graph.history import Step
from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.theme import type_font
from nvsim_app.state.document import Document

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()


class HistoryModel(QAbstractListModel):
    """One row for each step; the first one is the opened graph.

    Steps after the current one are gray. Steps that come from outside this window are in italics.
    """

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._shown: tuple[Step, ...] = ()
        document.editing.stepsChanged.connect(self._renew)
        self._renew()

    def _renew(self) -> None:
        """Adds and removes only the rows that changed, because a history can have thousands of steps."""
        history = self._document.editing.history
        steps = () if history is None else history.steps
        before, kept = self._shown, min(len(self._shown), len(steps))
        while kept and before[kept - 1] is not steps[kept - 1]:
            kept -= 1
        if not kept:
            self.beginResetModel()
            self._shown = steps
            self.endResetModel()
            return
        if len(before) > kept:
            self.beginRemoveRows(_ROOT, kept, len(before) - 1)
            self._shown = steps[:kept]
            self.endRemoveRows()
        if len(steps) > kept:
            self.beginInsertRows(_ROOT, kept, len(steps) - 1)
            self._shown = steps
            self.endInsertRows()
        self.dataChanged.emit(self.index(0), self.index(len(steps) - 1))

    @property
    def current(self) -> int:
        history = self._document.editing.history
        return -1 if history is None else history.index

    def rowCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._shown)

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        history = self._document.editing.history
        if history is None or not index.isValid() or index.row() >= len(self._shown):
            return None
        row = index.row()
        step = self._shown[row]
        if role == Qt.ItemDataRole.DisplayRole:
            return plain(short_ids(self._document.graph, step.text))
        if role == Qt.ItemDataRole.ToolTipRole:
            when = time.strftime("%d %b %H:%M:%S", time.localtime(step.when))
            return tooltip_text(f"{when}, not edited in this window" if step.outside else when)
        if role == Qt.ItemDataRole.ForegroundRole and row > history.index:
            return QColor(colors.text("quiet"))
        if role == Qt.ItemDataRole.FontRole and (row == history.index or step.outside):
            font = type_font(bold=row == history.index)
            font.setItalic(step.outside)
            return font
        return None


class HistoryPanel(QWidget):
    """The list of steps."""

    def __init__(self, document: Document, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self.model = HistoryModel(document, self)
        self.list = QListView(self)
        self.list.setAccessibleName("History of edits")
        self.list.setModel(self.model)
        self.list.setUniformItemSizes(True)
        self.list.setFrameShape(self.list.Shape.NoFrame)
        self.list.setToolTip("Click a step to go to it")
        self.list.clicked.connect(self._go_to_row)
        document.editing.stepsChanged.connect(self._show_current)
        vbox(self.list, on=self, margins=0)
        self._show_current()

    def _go_to_row(self, index: QModelIndex) -> None:
        self._document.editing.go_to(index.row())

    def _show_current(self) -> None:
        if self.model.current >= 0:
            index = self.model.index(self.model.current)
            self.list.setCurrentIndex(index)
            self.list.scrollTo(index)
