"""The comparison with another graph: a list of differences, which are drawn in both views and can be merged."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PySide6.QtCore import QModelIndex, Qt, Signal
from PySide6.QtGui import QPalette
from PySide6.QtWidgets import QComboBox, QHeaderView, QStyledItemDelegate, QStyleOptionViewItem, QWidget

from nvsim.errors import InputError
from nvsim.graph.compare import Comparison, Deviation, compare
from nvsim.graph.foreign import ForeignFile
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import NavGraph
from nvsim.project.work import STAGE
from nvsim_app.layers.labels import short_ids
from nvsim_app.look import colors
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import Label, WrappingRow
from nvsim_app.look.plain_text import plain
from nvsim_app.look.table import Column, Index, TableModel, table
from nvsim_app.look.widgets import push_button

INKS = {
    "viewpoint added": colors.OPEN,
    "viewpoint removed": colors.BLOCKED,
    "viewpoint moved": colors.SELECTED,
    "viewpoint changed": colors.TRAJECTORY,
    "edge added": colors.OPEN,
    "edge removed": colors.BLOCKED,
}


class DeviationModel(TableModel[Deviation]):
    """One row for each difference, with a check box that selects it for the merge."""

    def __init__(self, parent: QWidget) -> None:
        columns: tuple[Column[Deviation], ...] = (
            Column("Difference", lambda found: found.kind, ink=lambda found: INKS[found.kind]),
            Column("In the other graph", lambda found: short_ids(self._graph, found.words)),
        )
        super().__init__(columns, parent, about=lambda found: found.words)
        self._graph: NavGraph | None = None
        self.chosen: set[Deviation] = set()

    def show_differences(self, found: tuple[Deviation, ...], graph: NavGraph | None) -> None:
        """Lists the differences `found` between `graph` and the other graph."""
        self._graph = graph
        self.chosen &= set(found)
        self.show(found)

    def choose(self, rows: Iterable[Deviation]) -> None:
        """Selects exactly these differences."""
        self.chosen = set(rows)
        if self.rowCount():
            self.dataChanged.emit(self.index(0, 0), self.index(self.rowCount() - 1, 0))

    def flags(self, index: Index) -> Qt.ItemFlag:
        boxed = Qt.ItemFlag.ItemIsUserCheckable if index.column() == 0 else Qt.ItemFlag.NoItemFlags
        return super().flags(index) | boxed

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if role == Qt.ItemDataRole.CheckStateRole and index.isValid() and index.column() == 0:
            return Qt.CheckState.Checked if self.row(index.row()) in self.chosen else Qt.CheckState.Unchecked
        return super().data(index, role)

    def setData(self, index: Index, value: object, role: int = Qt.ItemDataRole.EditRole) -> bool:
        if role != Qt.ItemDataRole.CheckStateRole or not index.isValid():
            return False
        found = self.row(index.row())
        (self.chosen.add if Qt.CheckState(value) == Qt.CheckState.Checked else self.chosen.discard)(found)
        self.dataChanged.emit(index, index)
        return True


class _BoxDelegate(QStyledItemDelegate):
    """Draws visible check boxes on a dark table, where the border of the style is too dark."""

    def initStyleOption(self, option: QStyleOptionViewItem, index: Index) -> None:
        super().initStyleOption(option, index)
        option.palette.setColor(QPalette.ColorRole.Window, option.palette.placeholderText().color().lighter(140))


class ComparePanel(QWidget):
    """The list of differences and its controls.

    opened(): select another graph. stepped(int): compare with the graph after that step of the history. closed(): end
    the comparison. merged(list of Deviation): merge these. activated(GraphSelection): a row was double-clicked.
    """

    opened = Signal()
    stepped = Signal(int)
    closed = Signal()
    merged = Signal(object)
    activated = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self.compared: ComparedGraphs | None = None
        self.model = DeviationModel(self)
        self.open = push_button("Other graph…", self, self.opened, "Select a connectivity file to compare with")
        self.steps = QComboBox(self, sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.steps.setAccessibleName("Earlier step to compare with")
        self.steps.setToolTip("Compare with the graph after a step of the history")
        self.steps.activated.connect(self._on_step)
        self.close_button = push_button("Close", self, self.closed, "End the comparison")
        self.words = Label("Select another graph, or a step of the history, to compare with.", self, wordWrap=True)
        self.table = table(self.model, self, "Differences")
        self.table.setWordWrap(False)
        self.table.setItemDelegate(_BoxDelegate(self.table))
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        header.resizeSection(0, 150)
        self.table.doubleClicked.connect(self._on_double_click)
        self.all = push_button("Select all", self, self._choose_all)
        self.merge = push_button(
            "Merge selected", self, self._on_merge, "Apply the selected differences to the edited graph, as one step"
        )
        self.model.dataChanged.connect(self._enable)
        top = hbox(self.open, (self.steps, 1))
        bottom = WrappingRow(self.all, self.close_button, self.merge)
        vbox(top, self.words, (self.table, 1), bottom, on=self, margins=4, spacing=4)
        self.show_compared(None)

    def show_steps(self, texts: tuple[str, ...], current: int) -> None:
        """Lists the steps of the history to compare with."""
        self.steps.clear()
        self.steps.addItem("Earlier step…", -1)
        for i, text in enumerate(texts):
            if i != current:
                self.steps.addItem(f"{i}: {plain(text)}", i)

    def show_compared(self, compared: ComparedGraphs | None) -> None:
        """Lists the differences; None clears the list."""
        self.compared = compared
        if compared is None:
            self.model.show_differences((), None)
        else:
            self.model.show_differences(compared.comparison.deviations, compared.mine)
        if compared is None:
            self.words.setText("Select another graph, or a step of the history, to compare with.")
        else:
            counts = {kind: n for kind, n in compared.comparison.counts().items() if n}
            changes = ", ".join(f"{n:,} {kind.split()[0]}{'s' if n > 1 else ''} {kind.split()[1]}"
                             for kind, n in counts.items())  # fmt: skip
            self.words.setText(f"{plain(compared.name)}: {changes or 'no differences'}.")
        self._enable()

    def _enable(self, *_: object) -> None:
        self.close_button.setEnabled(self.compared is not None)
        self.all.setEnabled(bool(self.model.rows))
        self.merge.setEnabled(bool(self.model.chosen))
        self.merge.setText(f"Merge {len(self.model.chosen):,} selected" if self.model.chosen else "Merge selected")

    def _choose_all(self) -> None:
        everything = len(self.model.chosen) == len(self.model.rows)
        self.model.choose(() if everything else self.model.rows)
        self._enable()

    def _on_step(self, row: int) -> None:
        step = self.steps.itemData(row)
        if isinstance(step, int) and step >= 0:
            self.stepped.emit(step)

    def _on_merge(self) -> None:
        self.merged.emit([d for d in self.model.rows if d in self.model.chosen])

    def _on_double_click(self, index: QModelIndex) -> None:
        found: Deviation = self.model.row(index.row())
        self.activated.emit(
            GraphSelection(
                frozenset({found.viewpoint} if found.viewpoint else ()), frozenset({found.edge} if found.edge else ())
            )
        )


@dataclass(frozen=True, eq=False)
class ComparedGraphs:
    """Two graphs and their differences.

    name         display name of the other graph
    mine, other  the edited graph and the other graph
    """

    name: str
    mine: NavGraph
    other: NavGraph
    comparison: Comparison

    @staticmethod
    def of(name: str, mine: NavGraph, other: NavGraph) -> ComparedGraphs:
        return ComparedGraphs(name, mine, other, compare(mine, other))

    def place(self, id: str) -> tuple[float, float, float] | None:
        """The floor point of a viewpoint in meters, world: in the edited graph, else in the other graph."""
        found = self.mine.viewpoints.get(id) or self.other.viewpoints.get(self.comparison.matched.get(id, id))
        return None if found is None else _foot(found.position, found.height)

    def other_place(self, id: str) -> tuple[float, float, float] | None:
        """The floor point of a viewpoint in the other graph."""
        found = self.other.viewpoints.get(self.comparison.matched.get(id, id))
        return None if found is None else _foot(found.position, found.height)

    def of_kind(self, kind: str) -> list[Deviation]:
        return [d for d in self.comparison.deviations if d.kind == kind]


def read_graph(path: Path) -> NavGraph:
    """The graph of a connectivity file or a project. Raises InputError if it has no graph or cannot be read."""
    if path.is_dir():
        from nvsim.project.project import Project

        with Project.open(path) as project:
            graph = project.graph()
        if graph is None:
            raise InputError(f"{path} has no {STAGE['map'].result} yet; choose another.")
        return graph
    return ForeignFile.open(path).graph


def _foot(position: tuple[float, float, float], height: float) -> tuple[float, float, float]:
    return position[0], position[1], position[2] - height
