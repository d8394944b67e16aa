"""Tables: one model for all, with declared columns and sorting; and the view that shows them.

The text of a cell is computed when it is shown. Only sorting reads all rows, a few thousand at a time, so that a table
of 40,000 rows stays responsive.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QAbstractItemModel, QAbstractTableModel, QModelIndex, QPersistentModelIndex, QSize, Qt
from PySide6.QtGui import QColor, QFont, QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QStyledItemDelegate,
    QStyleOptionViewItem,
    QTableView,
    QWidget,
)

from nvsim_app.look import lengths
from nvsim_app.look.plain_text import SENTENCE, in_window, plain, tooltip_text

Index = QModelIndex | QPersistentModelIndex
Row = TypeVar("Row", bound=Hashable)
Result = TypeVar("Result")
STRIDE = 2000  # rows that are read between two pauses
LOW = 64  # preferred height of a table, pixels; layouts stretch it
FEW = 4  # up to this many rows are searched one by one
_ROOT = QModelIndex()
_SHORT = 200  # rows of a table in which columns without text are found
_GAP = "\u2002"  # after right-aligned text, so that it does not touch the next column
_RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


@dataclass(frozen=True)
class Column(Generic[Row]):
    """One column of a table.

    value     value of a row, by which the table is sorted
    text      a value as text
    tip       tooltip of the header
    about     tooltip of a cell, if it differs from that of its row
    number    whether the cells are right-aligned
    width     in pixels; 0 for the default of the view
    measured  whether the value is a length, so that the title names its unit
    ink       color of the text as #rrggbb, "" for the normal one
    font      font of the text, None for the normal one
    icon      image beside the text
    optional  hidden if the table is too narrow for all columns: first those without text, then the last one first
    """

    title: str
    value: Callable[[Row], Any]
    text: Callable[[Any], str] = str
    tip: str = ""
    about: Callable[[Row], str] | None = None
    number: bool = False
    width: int = 0
    measured: bool = False
    ink: Callable[[Row], str] | None = None
    font: Callable[[Row], QFont | None] | None = None
    icon: Callable[[Row], Any] | None = None
    optional: bool = False


def _no_words(_: object) -> str:
    return ""


class TableModel(QAbstractTableModel, Generic[Row]):
    """Rows in the current sort order.

    key      what identifies a row: while the keys stay the same, rows are updated in place
    about    tooltip of a row
    in_place whether rows are inserted and removed one by one, so that the others keep their widgets
    dense    whether rows are low and columns narrow, for a short list in a side panel
    """

    def __init__(
        self,
        columns: Sequence[Column[Row]] = (),
        parent: QWidget | None = None,
        key: Callable[[Row], Hashable] = lambda row: row,
        about: Callable[[Row], str] = _no_words,
        in_place: bool = False,
        dense: bool = False,
    ) -> None:
        super().__init__(parent)
        self.columns, self.dense = tuple(columns), dense
        self._key, self._about, self._in_place = key, about, in_place
        self._all: Sequence[Row] = ()
        self._order = np.zeros(0, np.int64)  # (N,) indices into `_all` of the shown rows
        self._place_of: dict[Row, int] | None = None
        self._sorted = (-1, Qt.SortOrder.AscendingOrder)

    # Rows -------------------------------------------------------------------------------------------------------

    @property
    def rows(self) -> list[Row]:
        """The shown rows in their order."""
        return [self._all[i] for i in self._order.tolist()]

    def row(self, place: int) -> Row:
        return self._all[int(self._order[place])]

    def show(self, rows: Sequence[Row], columns: Sequence[Column[Row]] | None = None) -> None:
        """Replaces the rows, and the columns if they are given."""
        finished(self.show_slowly(rows, columns))

    def show_slowly(
        self, rows: Sequence[Row], columns: Sequence[Column[Row]] | None = None
    ) -> Generator[None, None, None]:
        """`show` in steps. The table changes only at the end of the iteration."""
        wanted = self.columns if columns is None else tuple(columns)
        order = yield from self._arranged(rows, wanted)
        same = wanted is self.columns and self._keeps_keys(rows, order)
        if not same:
            self.beginResetModel()
        self.columns, self._all = wanted, rows
        self._order, self._place_of = order, None
        if not same:
            self.endResetModel()
        elif len(order):
            self.dataChanged.emit(self.index(0, 0), self.index(len(order) - 1, len(wanted) - 1))

    def _keeps_keys(self, rows: Sequence[Row], order: NDArray[np.int64]) -> bool:
        """Whether the shown rows have the keys of `rows`, after inserting and removing rows if that is allowed."""
        before, after = [*map(self._key, self.rows)], [self._key(rows[i]) for i in order.tolist()]
        if not self._in_place or before == after:
            return before == after
        old, new = set(before), set(after)
        if [key for key in before if key in new] != [key for key in after if key in old]:
            return False  # the order of the common rows has changed
        self._place_of = None
        for place in reversed(range(len(before))):
            if before[place] not in new:
                self.beginRemoveRows(_ROOT, place, place)
                self._order = np.delete(self._order, place)
                self.endRemoveRows()
        self._all, self._order = rows, order[[key in old for key in after]]
        for place, key in enumerate(after):
            if key not in old:
                self.beginInsertRows(_ROOT, place, place)
                self._order = np.insert(self._order, place, order[place])
                self.endInsertRows()
        return True

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        self.layoutAboutToBeChanged.emit()
        before = [(index, self.row(index.row())) for index in self.persistentIndexList()]
        self._sorted = (column, order)
        self._order = finished(self._arranged(self._all, self.columns))
        self._place_of = None
        for index, row in before:
            self.changePersistentIndex(index, self.index(self._places[row], index.column()))
        self.layoutChanged.emit()

    def places_of(self, rows: frozenset[Row]) -> list[int]:
        """The places of these rows in ascending order, without rows that are not shown."""
        if len(rows) <= FEW:
            found = [self._all.index(row) for row in rows if row in self._all]
            return sorted(int(place) for place in np.flatnonzero(np.isin(self._order, found)))
        return sorted(self._places[row] for row in rows if row in self._places)

    @property
    def _places(self) -> dict[Row, int]:
        if self._place_of is None:
            self._place_of = {row: place for place, row in enumerate(self.rows)}
        return self._place_of

    def _arranged(
        self, rows: Sequence[Row], columns: tuple[Column[Row], ...]
    ) -> Generator[None, None, NDArray[np.int64]]:
        """(N,) int64 indices into `rows` in sort order."""
        column, direction = self._sorted
        if not 0 <= column < len(columns) or not len(rows):
            return np.arange(len(rows))
        value = columns[column].value
        values: list[Any] = []
        for start in range(0, len(rows), STRIDE):
            values += map(value, rows[start : start + STRIDE])
            yield
        if any(v is None for v in values):
            places = np.array(sorted(range(len(values)), key=lambda i: (values[i] is None, values[i] or 0)))
        else:
            places = np.argsort(np.asarray(values), kind="stable")
        return places if direction == Qt.SortOrder.AscendingOrder else places[::-1]

    def refresh_text(self) -> None:
        """Updates all cells, for example after the unit of lengths changed."""
        self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(self.columns) - 1)
        self.layoutChanged.emit()

    # Qt ---------------------------------------------------------------------------------------------------------

    def rowCount(self, parent: Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self._order)

    def columnCount(self, parent: Index = _ROOT) -> int:
        return 0 if parent.isValid() else len(self.columns)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if orientation != Qt.Orientation.Horizontal or not 0 <= section < len(self.columns):
            return None
        column = self.columns[section]
        if role == Qt.ItemDataRole.DisplayRole:
            title = f"{column.title}, {lengths.unit().symbol}" if column.measured else column.title
            return title + _GAP if column.number and not self.dense else title
        if role == Qt.ItemDataRole.ToolTipRole:
            return tooltip_text(column.tip) or None
        return _RIGHT if role == Qt.ItemDataRole.TextAlignmentRole and column.number else None

    def data(self, index: Index, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        if not index.isValid() or index.row() >= len(self._order):
            return None
        column = self.columns[index.column()]
        if role == Qt.ItemDataRole.TextAlignmentRole:
            return _RIGHT if column.number else None
        row = self.row(index.row())
        if role == Qt.ItemDataRole.DisplayRole:
            return plain(in_window(column.text(column.value(row))), SENTENCE)
        if role == Qt.ItemDataRole.UserRole:
            return column.value(row)
        if role == Qt.ItemDataRole.ToolTipRole:
            return tooltip_text((column.about or self._about)(row)) or None
        if role == Qt.ItemDataRole.ForegroundRole and column.ink is not None and (ink := column.ink(row)):
            return QColor(ink)
        if role == Qt.ItemDataRole.FontRole and column.font is not None:
            return column.font(row)
        if role == Qt.ItemDataRole.DecorationRole and column.icon is not None:
            return column.icon(row)
        return None


def finished(steps: Generator[None, None, Result]) -> Result:
    """Runs all `steps` at once and returns their result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: Result = end.value
            return result


class _Cells(QStyledItemDelegate):
    def initStyleOption(self, option: QStyleOptionViewItem, index: Index) -> None:
        super().initStyleOption(option, index)
        model = index.model()
        is_dense = isinstance(model, TableModel) and model.dense
        if option.displayAlignment & Qt.AlignmentFlag.AlignRight and not is_dense:
            option.text += _GAP


class TableView(QTableView):
    """A table that hides optional columns if it is too narrow for all columns."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._needed: dict[int, int] = {}  # the width of each column when it was last shown
        self._least: dict[int, int] = {}  # the width of the widgets in a column, pixels

    def setModel(self, model: QAbstractItemModel | None) -> None:
        super().setModel(model)
        if isinstance(model, TableModel) and any(column.optional for column in model.columns):
            for changed in (model.modelReset, model.rowsInserted, model.layoutChanged, model.dataChanged):
                changed.connect(self.fit)

    def fit(self, *_: object) -> None:
        """Hides optional columns until the others fit: first those without text, then the last one first."""
        model = self.model()
        columns = model.columns if isinstance(model, TableModel) else ()
        if not any(column.optional for column in columns):
            return
        widths = [self._width(place, column) for place, column in enumerate(columns)]
        # The room does not depend on whether the scroll bar is shown, which depends on the columns.
        room = self.width() - 2 * self.frameWidth() - self.verticalScrollBar().sizeHint().width()
        room -= sum(w for w, column in zip(widths, columns, strict=True) if not column.optional)
        optional = [place for place, column in enumerate(columns) if column.optional]
        for place in sorted(optional, key=self._is_empty):
            room -= widths[place]
            if self.isColumnHidden(place) != (room < 0):
                self.setColumnHidden(place, room < 0)

    def _is_empty(self, place: int) -> bool:
        """Whether a column of a short table has no text."""
        model = self.model()
        if not isinstance(model, TableModel) or not 0 < len(model.rows) <= _SHORT:
            return False
        column = model.columns[place]
        return not any(column.text(column.value(row)) for row in model.rows)

    def set_widgets_width(self, place: int, width: int) -> None:
        """Gives a column at least the width of the widgets in it, in pixels."""
        if self._least.get(place) != width:
            self._least[place] = width
            self.setColumnWidth(place, width)
            self.fit()

    def _width(self, place: int, column: Column[Any]) -> int:
        """The width that a column needs, in pixels. Columns that the panel hides need none."""
        if not self.isColumnHidden(place):
            title = self.horizontalHeader().sectionSizeHint(place)
            content = max(column.width, self._least.get(place, 0)) or self.sizeHintForColumn(place)
            self._needed[place] = max(title, content)
        elif not column.optional:
            return 0
        return self._needed.get(place, column.width)  # the title of a hidden column has no size

    def sizeHint(self) -> QSize:
        """A low table, so that a panel with a table has only the scroll bar of the table."""
        return QSize(super().sizeHint().width(), max(LOW, self.minimumHeight()))

    def resizeEvent(self, event: QResizeEvent) -> None:
        self.fit()
        super().resizeEvent(event)


def table(model: QAbstractItemModel, parent: QWidget | None, name: str = "") -> TableView:
    """A plain table that selects whole rows, without a grid and without row numbers. `name` is for screen readers.
    Columns that declare a width get it, or that of their title; if none does, the columns fit their texts."""
    view = TableView(parent)
    view.setModel(model)
    style_table(view, name)
    return view


def style_table(view: TableView, name: str = "") -> None:
    """Applies the common style and column widths to a table that has a model; see `table`."""
    model = view.model()
    view.setItemDelegate(_Cells(view))
    view.setWordWrap(False)
    view.setAccessibleName(name)
    view.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    view.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
    view.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
    view.setShowGrid(False)
    view.setTabKeyNavigation(False)  # Tab moves to the next control
    view.setAlternatingRowColors(True)
    view.setFrameShape(view.Shape.NoFrame)
    view.verticalHeader().hide()
    is_dense = isinstance(model, TableModel) and model.dense
    view.verticalHeader().setMinimumSectionSize(0)
    view.verticalHeader().setDefaultSectionSize(view.fontMetrics().height() + 2 if is_dense else 24)
    header = view.horizontalHeader()
    header.setHighlightSections(False)
    header.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
    header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    header.setStretchLastSection(not is_dense)
    columns = model.columns if isinstance(model, TableModel) else ()
    if is_dense and columns:  # the column of names takes the room that is left
        names = next(place for place, column in enumerate(columns) if column.title)
        header.setSectionResizeMode(names, QHeaderView.ResizeMode.Stretch)
    widths = [column.width for column in columns]
    if any(widths):  # measuring every row of a large table would take seconds
        header.setSectionResizeMode(QHeaderView.ResizeMode.Interactive)
        for section, width in enumerate(widths):
            if width:
                header.resizeSection(section, max(width, header.sectionSizeHint(section)))
