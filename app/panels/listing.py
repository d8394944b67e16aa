"""The viewpoints and edges of a graph as sortable rows.

The text of a cell is computed when it is shown. Only sorting reads all rows, a few thousand at a time, so that a table
of 40,000 rows stays responsive.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtWidgets import QWidget

from app.layers.labels import short_id
from app.look import lengths
from app.look.plain_text import plain, tip
from nvsim.graph.clearness_cache import ClearnessCache
from nvsim.graph.types import EdgeKey, NavGraph

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
Key = TypeVar("Key", bound=Hashable)
STRIDE = 2000  # rows that are read between two pauses
FEW = 4  # up to this many keys are searched one by one


@dataclass(frozen=True)
class Facts:
    """The input of the columns: one state of the graph, and the cached evidence of its edges."""

    graph: NavGraph
    evidence: ClearnessCache

    def length(self, key: EdgeKey) -> float:
        """The length of an edge in meters."""
        a, b = (self.graph.viewpoints[id].position for id in key)
        return math.dist(a, b)


@dataclass(frozen=True)
class Column(Generic[Key]):
    """One column of a table.

    value     value of a row, by which the table is sorted
    text      a value as text
    number    whether the cells are right-aligned
    width     in pixels
    measured  whether the value is a length
    id        whether the value is a viewpoint id
    """

    title: str
    tip: str
    value: Callable[[Facts, Key], Any]
    text: Callable[[Any], str] = str
    number: bool = False
    width: int = 76
    measured: bool = False
    id: bool = False


def _yes(value: object) -> str:
    return "yes" if value else "–"


def _metres(value: float) -> str:
    return lengths.figure(value)


def _share(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"


def _of_viewpoint(name: str) -> Callable[[Facts, str], Any]:
    return lambda facts, id: getattr(facts.graph.viewpoints[id], name)


def _of_edge(name: str) -> Callable[[Facts, EdgeKey], Any]:
    return lambda facts, key: getattr(facts.graph.edges[key], name)


def _axis(axis: int) -> Callable[[Facts, str], float]:
    return lambda facts, id: facts.graph.viewpoints[id].position[axis]


VIEWPOINT_COLUMNS: tuple[Column[str], ...] = (
    Column("Viewpoint", "Identifier", lambda f, id: id, id=True),
    Column("Degree", "Number of edges", lambda f, id: len(f.graph.neighbours(id)), str, True),
    Column("Submap", "Submap that renders it", _of_viewpoint("submap"), lambda v: "–" if v < 0 else str(v), True),
    Column("Height", "Height above the floor", _of_viewpoint("height"), _metres, True, measured=True),
    Column("x", "Camera position", _axis(0), _metres, True, measured=True),
    Column("y", "Camera position", _axis(1), _metres, True, measured=True),
    Column("z", "Camera position", _axis(2), _metres, True, measured=True),
    Column("Included", "Whether agents use it", _of_viewpoint("included"), _yes),
    Column("Reviewed", "Whether a user reviewed it", _of_viewpoint("reviewed"), _yes),
    Column("Locked", "Whether it is protected from edits", _of_viewpoint("locked"), _yes),
    Column("Origin", "Created by a step of the search, a merge, a user, or a file", _of_viewpoint("origin"), str),
)

EDGE_COLUMNS: tuple[Column[EdgeKey], ...] = (
    Column("From", "First viewpoint", lambda f, key: key[0], id=True),
    Column("To", "Second viewpoint", lambda f, key: key[1], id=True),
    Column("Length", "From camera to camera", Facts.length, _metres, True, measured=True),
    Column("Evidence", "1 if every measured corridor is clear, 0 if one is blocked; – without evidence",
           lambda f, key: f.evidence.at(f.graph, key), _share, True),
    Column("Reviewed", "Whether a user reviewed it", _of_edge("reviewed"), _yes),
    Column("Locked", "Whether it is protected from edits", _of_edge("locked"), _yes),
    Column("Origin", "Created by a step of the search, a merge, a user, or a file", _of_edge("origin"), str),
)  # fmt: skip


Result = TypeVar("Result")


def finished(steps: Generator[None, None, Result]) -> Result:
    """Runs all `steps` at once and returns their result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: Result = end.value
            return result


class GraphTable(QAbstractTableModel, Generic[Key]):
    """One row for each viewpoint or edge that passes the filter, in the current sort order."""

    def __init__(
        self, columns: tuple[Column[Key], ...], keys: Callable[[NavGraph], Sequence[Key]], parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._columns, self._keys_of = columns, keys
        self._facts: Facts | None = None
        self._all: Sequence[Key] = ()
        self._rows = np.zeros(0, np.int64)
        self._row_of: dict[Key, int] | None = None
        self._kept: frozenset[Key] | None = None
        self._sorted = (-1, Qt.SortOrder.AscendingOrder)

    def show(self, facts: Facts | None, kept: frozenset[Key] | None = None) -> Iterator[None]:
        """Shows the rows of `facts` whose keys are in `kept`; None shows all. The table changes only at the end of the
        iteration."""
        every = () if facts is None else self._keys_of(facts.graph)
        rows = yield from self._arranged(facts, every, kept)
        self.beginResetModel()
        self._facts, self._all, self._kept = facts, every, kept
        self._rows, self._row_of = rows, None
        self.endResetModel()

    def width(self, column: int) -> int:
        """The default width of a column in pixels."""
        return self._columns[column].width

    def key(self, row: int) -> Key:
        return self._all[int(self._rows[row])]

    def rows_of(self, keys: frozenset[Key]) -> list[int]:
        """The row numbers of these keys in ascending order, without keys that the filter hides."""
        if len(keys) <= FEW:
            places = [self._all.index(key) for key in keys if key in self._all]
            return sorted(int(row) for row in np.flatnonzero(np.isin(self._rows, places)))
        if self._row_of is None:
            every = self._all
            self._row_of = dict(zip(map(every.__getitem__, self._rows.tolist()), range(len(self._rows)), strict=True))
        return sorted(self._row_of[key] for key in keys if key in self._row_of)

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        self.layoutAboutToBeChanged.emit()
        self._sorted = (column, order)
        self._rows, self._row_of = finished(self._arranged(self._facts, self._all, self._kept)), None
        self.layoutChanged.emit()

    def _arranged(
        self, facts: Facts | None, every: Sequence[Key], kept: frozenset[Key] | None
    ) -> Generator[None, None, NDArray[np.int64]]:
        """(N,) int64 indices into `every` of the rows to show, in sort order."""
        rows = np.arange(len(every))
        if kept is not None:
            rows = np.flatnonzero(np.fromiter(map(kept.__contains__, every), bool, len(every)))
        column, order = self._sorted
        if facts is None or not 0 <= column < len(self._columns) or not len(rows):
            return rows
        value, values = self._columns[column].value, []
        for start in range(0, len(rows), STRIDE):
            values += [value(facts, every[row]) for row in rows[start : start + STRIDE].tolist()]
            yield
        places = np.argsort(np.asarray(values), kind="stable")
        return rows[places if order == Qt.SortOrder.AscendingOrder else places[::-1]]

    def refresh_text(self) -> None:
        """Updates all cells after the unit of lengths changed."""
        self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(self._columns) - 1)
        self.layoutChanged.emit()

    def rowCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._columns)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation != Qt.Orientation.Horizontal or not 0 <= section < len(self._columns):
            return None
        column = self._columns[section]
        if role == Qt.ItemDataRole.DisplayRole:
            return f"{column.title}, {lengths.unit().symbol}" if column.measured else column.title
        if role == Qt.ItemDataRole.ToolTipRole:
            return tip(column.tip)
        if role == Qt.ItemDataRole.TextAlignmentRole and column.number:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        return None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= len(self._rows):
            return None
        column = self._columns[index.column()]
        if role == Qt.ItemDataRole.TextAlignmentRole and column.number:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        key = self.key(index.row())
        if role == Qt.ItemDataRole.DisplayRole and self._facts is not None:
            value = column.value(self._facts, key)
            return short_id(self._facts.graph, value) if column.id else plain(column.text(value))
        if role == Qt.ItemDataRole.ToolTipRole:
            return tip(" – ".join(map(str, key)) if isinstance(key, tuple) else key)
        return None
