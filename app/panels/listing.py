"""The viewpoints and the edges of the graph as sortable rows. Sorting and filtering go by arrays, not row by row, so
that forty thousand rows stay quick."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QAbstractTableModel, QModelIndex, QPersistentModelIndex, Qt
from PySide6.QtWidgets import QWidget

from app.graph_arrays import GraphArrays
from app.overlays import short_id
from nvsim.graph.quantities import quantity
from nvsim.graph.types import NavGraph

_Index = QModelIndex | QPersistentModelIndex
_ROOT = QModelIndex()
Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True)
class Facts:
    """What the columns read, made once per state of the graph. degrees (N,) and lengths (M,) are in the order of the
    graph's viewpoints and edges."""

    graph: NavGraph
    degrees: NDArray[np.int64]
    lengths: NDArray[np.float64]
    evidence: NDArray[np.float64]

    @staticmethod
    def of(graph: NavGraph) -> Facts:
        arrays = GraphArrays.of(graph)
        degrees = np.bincount(arrays.edges.reshape(-1), minlength=len(arrays.ids))
        ends = arrays.positions[arrays.edges]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        return Facts(graph, degrees, lengths, quantity(graph, "evidence", kind="edges")[1])


@dataclass(frozen=True)
class Column(Generic[Key]):
    """values    of all rows, in the order of the graph, to sort by: an array or a list of strings
    text      of one value
    number    whether it stands at the right
    width     pixels
    """

    title: str
    tip: str
    values: Callable[[Facts], Sequence[Any] | NDArray[Any]]
    text: Callable[[Any], str] = str
    number: bool = False
    width: int = 76


def _yes(value: object) -> str:
    return "yes" if value else "–"


def _metres(value: float) -> str:
    return f"{value:.2f}"


def _share(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.2f}"


ORIGINS = {"start": "start", "step": "step", "merge": "merge", "person": "person", "file": "file"}

VIEWPOINT_COLUMNS: tuple[Column[str], ...] = (
    Column("Viewpoint", "Identifier", lambda f: list(f.graph.viewpoints), short_id),
    Column("Degree", "Edges that meet here", lambda f: f.degrees, str, True),
    Column("Submap", "The submap that renders it", lambda f: [v.submap for v in f.graph.viewpoints.values()],
           lambda v: "–" if v < 0 else str(v), True),
    Column("Height", "Metres above the floor",
           lambda f: [v.height for v in f.graph.viewpoints.values()], _metres, True),
    Column("x", "Metres", lambda f: [v.position[0] for v in f.graph.viewpoints.values()], _metres, True),
    Column("y", "Metres", lambda f: [v.position[1] for v in f.graph.viewpoints.values()], _metres, True),
    Column("z", "Metres", lambda f: [v.position[2] for v in f.graph.viewpoints.values()], _metres, True),
    Column("In", "Whether agents use it", lambda f: [v.included for v in f.graph.viewpoints.values()], _yes),
    Column("Reviewed", "Whether a person looked at it",
           lambda f: [v.reviewed for v in f.graph.viewpoints.values()], _yes),
    Column("Locked", "Whether edits leave it alone", lambda f: [v.locked for v in f.graph.viewpoints.values()], _yes),
    Column("From", "Who put it there", lambda f: [v.origin for v in f.graph.viewpoints.values()], str),
)  # fmt: skip

EDGE_COLUMNS: tuple[Column[tuple[str, str]], ...] = (
    Column("From", "One end", lambda f: [a for a, _ in f.graph.edges], short_id),
    Column("To", "The other end", lambda f: [b for _, b in f.graph.edges], short_id),
    Column("Length", "Metres", lambda f: f.lengths, _metres, True),
    Column("Evidence", "1 where every corridor that was measured is clear, 0 where one is full; – without evidence",
           lambda f: f.evidence, _share, True),
    Column("Reviewed", "Whether a person looked at it", lambda f: [e.reviewed for e in f.graph.edges.values()], _yes),
    Column("Locked", "Whether edits leave it alone", lambda f: [e.locked for e in f.graph.edges.values()], _yes),
    Column("Made by", "Who put it there", lambda f: [e.origin for e in f.graph.edges.values()], str),
)  # fmt: skip


class GraphTable(QAbstractTableModel, Generic[Key]):
    """One row for each viewpoint or edge that passes the filter, in the order sorted by."""

    def __init__(
        self, columns: tuple[Column[Key], ...], keys: Callable[[NavGraph], Sequence[Key]], parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._columns, self._keys_of = columns, keys
        self._values: list[Sequence[Any] | NDArray[Any]] = [() for _ in columns]
        self._all: Sequence[Key] = ()
        self._rows = np.zeros(0, np.int64)
        self._row_of: dict[Key, int] | None = None
        self._kept: frozenset[Key] | None = None
        self._sorted = (-1, Qt.SortOrder.AscendingOrder)

    def show(self, facts: Facts | None, kept: frozenset[Key] | None = None) -> None:
        """Shows these, of which only `kept` pass the filter; None lets all pass."""
        self.beginResetModel()
        self._all = () if facts is None else self._keys_of(facts.graph)
        self._values = [() if facts is None else column.values(facts) for column in self._columns]
        self._kept = kept
        self._arrange()
        self.endResetModel()

    def width(self, column: int) -> int:
        """Pixels that suit what stands in it."""
        return self._columns[column].width

    def key(self, row: int) -> Key:
        return self._all[int(self._rows[row])]

    def rows_of(self, keys: frozenset[Key]) -> list[int]:
        """Where these stand, in rising order; those that the filter hides are left out."""
        if self._row_of is None:
            self._row_of = {self._all[int(at)]: row for row, at in enumerate(self._rows)}
        return sorted(self._row_of[key] for key in keys if key in self._row_of)

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        self.layoutAboutToBeChanged.emit()
        self._sorted = (column, order)
        self._arrange()
        self.layoutChanged.emit()

    def _arrange(self) -> None:
        rows = np.arange(len(self._all))
        if self._kept is not None:
            rows = rows[[key in self._kept for key in self._all]] if len(rows) else rows
        column, order = self._sorted
        if 0 <= column < len(self._columns) and len(rows):
            values = np.asarray(self._values[column])[rows]
            places = np.argsort(values, kind="stable")
            rows = rows[places if order == Qt.SortOrder.AscendingOrder else places[::-1]]
        self._rows, self._row_of = rows, None

    def rowCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: _Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._columns)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation != Qt.Orientation.Horizontal or not 0 <= section < len(self._columns):
            return None
        column = self._columns[section]
        if role == Qt.ItemDataRole.DisplayRole:
            return column.title
        if role == Qt.ItemDataRole.ToolTipRole:
            return column.tip
        if role == Qt.ItemDataRole.TextAlignmentRole and column.number:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        return None

    def data(self, index: _Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= len(self._rows):
            return None
        column = self._columns[index.column()]
        if role == Qt.ItemDataRole.TextAlignmentRole and column.number:
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        value = self._values[index.column()]
        if role == Qt.ItemDataRole.DisplayRole:
            return column.text(value[int(self._rows[index.row()])])
        if role == Qt.ItemDataRole.ToolTipRole:
            key = self.key(index.row())
            return key if isinstance(key, str) else " – ".join(map(str, key)) if isinstance(key, tuple) else None
        return None
