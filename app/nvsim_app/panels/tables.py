"""The tables of viewpoints and edges."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

from PySide6.QtCore import QItemSelection, QItemSelectionModel, QModelIndex, Qt, Signal
from PySide6.QtWidgets import QAbstractItemView, QLineEdit, QTableView, QTabWidget, QWidget

from nvsim.errors import InputError
from nvsim.graph.clearness_cache import ClearnessCache
from nvsim.graph.edits import EditError
from nvsim.graph.expression import by_expression
from nvsim.graph.quantities import QuantityInputs
from nvsim.graph.selection import GraphSelection
from nvsim.graph.types import EdgeKey, NavGraph
from nvsim.plain_text import count_text
from nvsim_app.layers.labels import short_id
from nvsim_app.look import lengths
from nvsim_app.look.boxes import hbox, vbox
from nvsim_app.look.labels import InkLabel, Label
from nvsim_app.look.table import Column, TableModel, table
from nvsim_app.look.widgets import push_button
from nvsim_app.panels.deferred_refresh import DeferredRefresh
from nvsim_app.state.document import Document

_ID = re.compile(r"[0-9a-f]{2,32}|[A-Za-z0-9_-]{6,}")
_EMPTY = NavGraph("", {}, {})
SETTLE = 80  # milliseconds after the last edit until the rows are updated


class TablePanel(QWidget):
    """The tables and their filter. activated(GraphSelection): a row was double-clicked."""

    activated = Signal(object)

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self._linking = False
        self.viewpoints = TableModel(viewpoint_columns(_EMPTY), self, about=str)
        self.edges = TableModel(edge_columns(_EMPTY, document.evidence), self, about=" – ".join)
        self._models: tuple[TableModel[Any], TableModel[Any]] = (self.viewpoints, self.edges)
        self.filter = QLineEdit(self, placeholderText='degree > 4 and origin == "person"', clearButtonEnabled=True)
        self.filter.setAccessibleName("Expression that filters the rows")
        self.filter.setToolTip(
            "Shows the rows that match an expression; Enter selects them. Names: degree, height, included "
            "(viewpoints), length, slope, alpha (edges), component, storey, evidence, validity, submap, reviewed, "
            "locked, origin, x, y, z (both); and, or, not, comparisons, arithmetic. Or type a part of an id."
        )
        self.filter.textChanged.connect(self._on_typed)
        self.filter.returnPressed.connect(self.select_filtered)
        tip = "Select the matching viewpoints and edges in the graph (Enter)"
        self.select = push_button("Select", self, self.select_filtered, tip, enabled=False)
        self.trouble = InkLabel("warning", self)
        self.trouble.setWordWrap(True)
        self.trouble.hide()
        self.count = Label(self, quiet=True)
        self.tabs = QTabWidget(self, documentMode=True)
        self.views: tuple[QTableView, QTableView] = (self._view(self.viewpoints), self._view(self.edges))
        for view, title in zip(self.views, ("Viewpoints", "Edges"), strict=True):
            self.tabs.addTab(view, title)
            view.setAccessibleName(title)
            view.selectionModel().selectionChanged.connect(self._on_rows)
            view.doubleClicked.connect(self._activate)
        self.refresh = DeferredRefresh(self, self._renewal, SETTLE)
        self.refresh.refresh_after_edits_of(document)
        document.projectLeft.connect(self.filter.clear)
        document.editing.selectionChanged.connect(self._show_selection)
        for model in self._models:
            document.unitsChanged.connect(model.refresh_text)
        row = hbox((self.filter, 1), self.select, self.count)
        vbox(row, self.trouble, self.tabs, on=self, margins=(4, 4, 4, 0), spacing=4)
        self.refresh.finish()

    def _view(self, model: TableModel[Any]) -> QTableView:
        view = table(model, self)
        view.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        view.setSortingEnabled(True)
        view.horizontalHeader().setSortIndicator(-1, Qt.SortOrder.AscendingOrder)
        return view

    def _on_typed(self, text: str) -> None:
        self.select.setEnabled(bool(text.strip()))
        self.refresh.mark()

    def _renewal(self) -> Iterator[None]:
        graph = self._document.graph
        if "evidence" in self.filter.text() or "alpha" in self.filter.text():
            yield from self._document.evidence.fill()
        kept = None if graph is None else self._filtered()
        yield
        shown = graph or _EMPTY
        ids = [id for id in shown.viewpoints if kept is None or id in kept.viewpoints]
        keys = [key for key in shown.edges if kept is None or key in kept.edges]
        yield from self._without_selection_events(self.viewpoints.show_slowly(ids, viewpoint_columns(shown)))
        yield from self._without_selection_events(
            self.edges.show_slowly(keys, edge_columns(shown, self._document.evidence))
        )
        n, m = self.viewpoints.rowCount(), self.edges.rowCount()
        self.tabs.setTabText(0, f"Viewpoints ({n:,})")
        self.tabs.setTabText(1, f"Edges ({m:,})")
        self._show_selection()

    def _without_selection_events(self, steps: Iterator[None]) -> Iterator[None]:
        """Runs `steps`, and ignores selection changes that are caused by removed rows."""
        going_on = True
        while going_on:
            self._linking = True
            going_on = next(steps, self) is not self
            self._linking = False
            yield

    def _filtered(self) -> GraphSelection | None:
        graph, text = self._document.graph, self.filter.text().strip()
        self.trouble.hide()
        if not text or graph is None:
            return None
        try:
            return self._matching_elements(graph, text)
        except (EditError, InputError) as error:
            self.trouble.setText(str(error))
            self.trouble.show()
            return None

    def _matching_elements(self, graph: NavGraph, text: str) -> GraphSelection:
        """The viewpoints and edges that match. A part of an id matches all that contain it. An expression about one
        kind keeps all items of the other kind."""
        if _ID.fullmatch(text) and any(text in id for id in graph.viewpoints):
            return GraphSelection(
                frozenset(id for id in graph.viewpoints if text in id),
                frozenset(key for key in graph.edges if text in key[0] or text in key[1]),
            )
        return by_expression(
            graph, text, QuantityInputs(self._document.contents.occupancy, clearness=self._document.evidence.at)
        )

    def select_filtered(self) -> None:
        """Selects the matching viewpoints and edges."""
        found = self._filtered()
        if found is not None:
            self._document.editing.select(found)

    def _activate(self, index: QModelIndex) -> None:
        row = index.row()
        self.activated.emit(
            GraphSelection(frozenset({self.viewpoints.row(row)}))
            if index.model() is self.viewpoints
            else GraphSelection(frozenset(), frozenset({self.edges.row(row)}))
        )

    def _on_rows(self) -> None:
        if self._linking:
            return
        chosen = self._document.editing.selection
        active = self.sender()
        parts: list[frozenset] = []
        for view, model, now in zip(self.views, self._models, (chosen.viewpoints, chosen.edges), strict=True):
            if view.selectionModel() is not active:
                parts.append(now)
                continue
            hidden = now - frozenset(model.row(row) for row in range(model.rowCount()))
            rows = {model.row(index.row()) for index in view.selectionModel().selectedRows()}
            parts.append(frozenset(rows) | (hidden if self.filter.text() else frozenset()))
        self._linking = True
        self._document.editing.select(GraphSelection(parts[0], parts[1]))
        self._linking = False

    def _show_selection(self) -> None:
        chosen = self._document.editing.selection
        words = [count_text(len(chosen.viewpoints), "viewpoint") if chosen.viewpoints else "",
                 count_text(len(chosen.edges), "edge") if chosen.edges else ""]  # fmt: skip
        self.count.setText(", ".join(w for w in words if w) + (" selected" if any(words) else ""))
        if self._linking:
            return
        if not self.refresh.in_sight:
            self.refresh.mark()
            return
        self._linking = True
        for view, model, keys in zip(self.views, self._models, (chosen.viewpoints, chosen.edges), strict=True):
            rows = model.places_of(keys)
            view.selectionModel().select(_ranges(model, rows), QItemSelectionModel.SelectionFlag.ClearAndSelect | _ROWS)
            if len(rows) == 1:
                view.scrollTo(model.index(rows[0], 0))
        if chosen.edges and not chosen.viewpoints:
            self.tabs.setCurrentIndex(1)
        elif chosen.viewpoints and not chosen.edges:
            self.tabs.setCurrentIndex(0)
        self._linking = False


_ROWS = QItemSelectionModel.SelectionFlag.Rows


def _ranges(model: TableModel[Any], rows: list[int]) -> QItemSelection:
    """Groups ascending row numbers into as few ranges as possible."""
    found = QItemSelection()
    start: int | None = None
    last = model.columnCount() - 1
    for row, following in zip(rows, [*rows[1:], -2][: len(rows)], strict=True):
        start = row if start is None else start
        if following != row + 1:
            found.select(model.index(start, 0), model.index(row, last))
            start = None
    return found


_WIDTH = 76  # pixels
_ORIGIN = "Created by a step of the search, a merge, a user, or a file"


def _yes_or_dash(value: object) -> str:
    return "yes" if value else "–"


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}"


def viewpoint_columns(graph: NavGraph) -> tuple[Column[str], ...]:
    """The columns of rows that are ids of viewpoints of `graph`."""
    of = graph.viewpoints

    def length(title: str, tip: str, axis: int | None) -> Column[str]:
        return Column(
            title, lambda id: of[id].height if axis is None else of[id].position[axis], lengths.figure, tip,
            number=True, width=_WIDTH, measured=True,
        )  # fmt: skip

    return (
        Column("Viewpoint", lambda id: id, lambda id: short_id(graph, id), "Identifier", width=_WIDTH),
        Column("Degree", lambda id: len(graph.neighbors(id)), str, "Number of edges", number=True, width=_WIDTH),
        Column("Submap", lambda id: of[id].submap, lambda v: "–" if v < 0 else str(v), "Submap that renders it",
               number=True, width=_WIDTH),
        length("Height", "Height above the floor", None),
        *(length(title, "Camera position", axis) for axis, title in enumerate("xyz")),
        Column("Included", lambda id: of[id].included, _yes_or_dash, "Whether agents use it", width=_WIDTH),
        Column("Reviewed", lambda id: of[id].reviewed, _yes_or_dash, "Whether a user reviewed it", width=_WIDTH),
        Column("Locked", lambda id: of[id].locked, _yes_or_dash, "Whether it is protected from edits", width=_WIDTH),
        Column("Origin", lambda id: of[id].origin, str, _ORIGIN, width=_WIDTH),
    )  # fmt: skip


def edge_columns(graph: NavGraph, evidence: ClearnessCache) -> tuple[Column[EdgeKey], ...]:
    """The columns of rows that are keys of edges of `graph`, with the cached `evidence` of its edges."""
    of = graph.edges

    def length(key: EdgeKey) -> float:
        a, b = (graph.viewpoints[id].position for id in key)
        return math.dist(a, b)

    return (
        Column("From", lambda key: key[0], lambda id: short_id(graph, id), "First viewpoint", width=_WIDTH),
        Column("To", lambda key: key[1], lambda id: short_id(graph, id), "Second viewpoint", width=_WIDTH),
        Column("Length", length, lengths.figure, "From camera to camera", number=True, width=_WIDTH, measured=True),
        Column("Evidence", lambda key: evidence.at(graph, key), _share,
               "1 if every measured corridor is clear, 0 if one is blocked; – without evidence",
               number=True, width=_WIDTH),
        Column("Reviewed", lambda key: of[key].reviewed, _yes_or_dash, "Whether a user reviewed it", width=_WIDTH),
        Column("Locked", lambda key: of[key].locked, _yes_or_dash, "Whether it is protected from edits", width=_WIDTH),
        Column("Origin", lambda key: of[key].origin, str, _ORIGIN, width=_WIDTH),
    )  # fmt: skip
