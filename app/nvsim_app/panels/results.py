"""The results of evaluations: tables and plots that can be copied and saved."""

from __future__ import annotations

import time
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pyqtgraph
from PySide6.QtCore import QModelIndex, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QGuiApplication, QKeySequence, QShortcut
from PySide6.QtWidgets import QComboBox, QFileDialog, QHeaderView, QListWidget, QListWidgetItem, QSplitter, QWidget

from nvsim.errors import InputError
from nvsim.plain_text import capitalized
from nvsim_app.look import colors
from nvsim_app.look.boxes import STRETCH, hbox, vbox
from nvsim_app.look.icons import save_image
from nvsim_app.look.labels import Label
from nvsim_app.look.notices import Notices
from nvsim_app.look.plain_text import CAPTION, plain
from nvsim_app.look.table import Column, TableModel
from nvsim_app.look.table import table as quiet_table
from nvsim_app.look.theme import Plot
from nvsim_app.look.widgets import named, push_button
from nvsim_app.state.results import EvaluationResult, ResultTable, result_title, save_table, value_words

_FEW = 12  # rows whose names fit beside horizontal bars


class ResultModel(TableModel[tuple[Any, ...]]):
    """The cells of one table."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__((), parent)
        self.table = ResultTable("", (), ())

    def show_table(self, table: ResultTable) -> None:
        self.table = table
        self.show(table.rows, [_column(table, place) for place in range(len(table.columns))])


def _column(table: ResultTable, place: int) -> Column[tuple[Any, ...]]:
    is_name = table.is_summary and place == 0

    def exact_text(row: tuple[Any, ...]) -> str:
        return repr(row[place]) if isinstance(row[place], float) else str(row[place]) if is_name else ""

    number = any(isinstance(row[place], int | float) for row in table.rows)
    title = plain(capitalized(result_title(table.columns[place])), CAPTION)
    words = _name_words if is_name else value_words
    return Column(title, itemgetter(place), words, about=exact_text, number=number)


def _name_words(name: object) -> str:
    return capitalized(str(name))


class ResultPanel(QWidget):
    """Shows evaluation results. frameWanted(int) and submapWanted(int): a row about one was double-clicked."""

    frameWanted = Signal(int)
    submapWanted = Signal(int)

    def __init__(self, notices: Notices) -> None:
        super().__init__()
        self._notices = notices
        self.results: list[EvaluationResult] = []
        self.list = named(QListWidget(self), "Evaluations")
        self.list.setFrameShape(QListWidget.Shape.NoFrame)
        self.list.setSpacing(4)
        self.list.setWordWrap(True)
        self.list.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.list.currentRowChanged.connect(self._on_result)
        self.tables = named(QComboBox(self), "Table")
        self.tables.currentIndexChanged.connect(self._on_table)
        self.columns = named(QComboBox(self), "Column that is plotted")
        self.columns.currentIndexChanged.connect(lambda _: self._draw())
        self.copy = push_button("Copy", self, self._copy, "Copy the table with tabs, for a spreadsheet (Ctrl+C)")
        self.save = push_button("Save CSV…", self, self._choose_csv)
        self.save_plot = push_button("Save plot…", self, self._choose_plot)
        self.model = ResultModel(self)
        self.view = quiet_table(self.model, self, "Figures")
        self.view.doubleClicked.connect(self._on_double_clicked)
        QShortcut(QKeySequence.StandardKey.Copy, self.view, self._copy, context=Qt.ShortcutContext.WidgetShortcut)
        self.plot: Plot | None = None  # until a table has a column to plot, so that the window opens sooner
        self.empty = Label("Results appear here. Jobs > Evaluate computes them.", self, quiet=True)
        self.empty.setContentsMargins(8, 8, 8, 8)
        bar = hbox(self.tables, self.copy, self.save, STRETCH, margins=4, spacing=4)
        middle = QWidget(self)
        vbox(bar, (self.view, 1), on=middle, margins=0, spacing=0)
        above = hbox(self.columns, self.save_plot, STRETCH, margins=4, spacing=4)
        self._right = right = QWidget(self)
        self._plotted = vbox(above, on=right, margins=0, spacing=0)
        self.splitter = QSplitter(Qt.Orientation.Horizontal, self)
        for widget, stretch in ((self.list, 1), (middle, 3), (right, 2)):
            self.splitter.addWidget(widget)
            self.splitter.setStretchFactor(self.splitter.count() - 1, stretch)
        self.splitter.setSizes([190, 420, 330])
        vbox(self.empty, (self.splitter, 1), on=self, margins=0)
        self.show_results([])

    # Showing ----------------------------------------------------------------------------------------------------

    def show_results(self, results: list[EvaluationResult]) -> None:
        """Lists the results, newest first. A new result is shown at once."""
        results = sorted(results, key=lambda r: -r.at)
        if [(r.key, r.at) for r in results] == [(r.key, r.at) for r in self.results] and results:
            return
        row = self.list.currentRow()
        chosen = self.results[row].key if 0 <= row < len(self.results) else ""
        newest = bool(results) and results[0].key not in {r.key for r in self.results}
        self.results = results
        with QSignalBlocker(self.list):
            self.list.clear()
            for result in results:
                when = time.strftime("%d %b %H:%M", time.localtime(result.at)) if result.at else ""
                item = QListWidgetItem(f"{plain(result.title)}\n{when}" if when else plain(result.title))
                self.list.addItem(item)
        self.empty.setVisible(not results)
        self.splitter.setVisible(bool(results))
        keys = [r.key for r in results]
        if results:
            self.list.setCurrentRow(0 if newest or chosen not in keys else keys.index(chosen))

    def _on_result(self, row: int) -> None:
        tables = self.results[row].tables if 0 <= row < len(self.results) else ()
        former = self.tables.currentText()
        with QSignalBlocker(self.tables):
            self.tables.clear()
            self.tables.addItems([plain(t.title, CAPTION) for t in tables])
            self.tables.setCurrentText(former)
        self._on_table(self.tables.currentIndex())

    def _on_table(self, index: int) -> None:
        row = self.list.currentRow()
        tables = self.results[row].tables if 0 <= row < len(self.results) else ()
        self.model.show_table(tables[index] if 0 <= index < len(tables) else ResultTable("", (), ()))
        self._fit_names()
        former = self.columns.currentText()
        with QSignalBlocker(self.columns):
            self.columns.clear()
            titles = [capitalized(result_title(self.model.table.columns[i])) for i in self.model.table.columns_to_plot]
            self.columns.addItems([plain(title, CAPTION) for title in titles])
            self.columns.setCurrentText(former)
        self._draw()

    def _fit_names(self) -> None:
        """Gives the names of figures the room that the values leave, so that the values are visible in a small
        window."""
        header, named = self.view.horizontalHeader(), self.model.table.is_summary
        header.setStretchLastSection(not named)
        for place in range(header.count()):
            names = named and place == 0
            mode = QHeaderView.ResizeMode.Stretch if names else QHeaderView.ResizeMode.ResizeToContents
            header.setSectionResizeMode(place, mode)

    def _add_plot(self) -> Plot:
        plot = Plot("Plot of the figures", self._right)
        plot.setMouseEnabled(x=True, y=True)
        plot.showGrid(y=True, alpha=0.15)
        plot.setMinimumWidth(160)
        self._plotted.addWidget(plot, 1)
        return plot

    def _draw(self) -> None:
        plotted, chosen = self.model.table.columns_to_plot, self.columns.currentIndex()
        shown = 0 <= chosen < len(plotted)
        for widget in (self.columns, self.save_plot):
            widget.setVisible(shown)
        self._right.setVisible(shown)  # otherwise the table has the space
        if not shown:
            return
        plot = self.plot = self.plot or self._add_plot()
        plot.clear()
        values = np.array(self.model.table.numbers(plotted[chosen]))
        known = np.flatnonzero(np.isfinite(values))
        names = [str(row[0]) for row in self.model.table.rows]
        few = len(values) <= _FEW
        if few:  # horizontal bars leave room for their names
            bars = pyqtgraph.BarGraphItem(x0=0.0, width=values[known], y=known, height=0.7, brush=colors.NODE, pen=None)
            plot.addItem(bars)
        elif len(values) <= 60:
            bars = pyqtgraph.BarGraphItem(x=known, height=values[known], width=0.7, brush=colors.NODE, pen=None)
            plot.addItem(bars)
        else:
            plot.plot(known, values[known], pen=pyqtgraph.mkPen(colors.NODE, width=1.5))
        plot.getPlotItem().invertY(few)  # in the order of the table
        step = 1 if few else max(1, len(names) // 8)
        ticks = [[(i, plain(names[i], 22)) for i in range(0, len(names), step)]]
        plot.getAxis("left").setTicks(ticks if few else None)
        plot.getAxis("bottom").setTicks(None if few else ticks)
        plot.show_title(self.columns.currentText())
        plot.autoRange()

    # Export -----------------------------------------------------------------------------------------------------

    def _copy(self) -> None:
        QGuiApplication.clipboard().setText(self.model.table.separated("\t"))

    def _choose_csv(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save table", f"{self.model.table.title}.csv", "CSV (*.csv)")
        if name:
            try:
                save_table(self.model.table, Path(name))
                self._notices.info(f"Saved {name}.", about="save")
            except InputError as error:
                self._notices.error(str(error), about="save")

    def _choose_plot(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, "Save plot", f"{self.columns.currentText()}.png", "PNG (*.png)")
        if name and self.plot is not None:
            try:
                save_image(self.plot.grab(), Path(name))
                self._notices.info(f"Saved {name}.", about="save")
            except InputError as error:
                self._notices.error(str(error), about="save")

    def _on_double_clicked(self, index: QModelIndex) -> None:
        row = dict(zip(self.model.table.columns, self.model.table.rows[index.row()], strict=True))
        if isinstance(row.get("frame"), int):
            self.frameWanted.emit(row["frame"])
        elif str(row.get("submap", "")).isdigit():
            self.submapWanted.emit(int(row["submap"]))
