"""The calibration panel: a row for each threshold with its suggested value, and the curves of the selected one."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QSignalBlocker, Qt, Signal
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QCheckBox, QComboBox, QHBoxLayout, QSplitter, QWidget

from nvsim.evaluation.calibrated import Judge
from nvsim_app.look import colors
from nvsim_app.look.boxes import STRETCH, hbox, vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.plain_text import plain, tooltip_text
from nvsim_app.look.table import Column, TableModel, table
from nvsim_app.look.theme import Plot, title_size
from nvsim_app.look.widgets import NumberBox, named, push_button
from nvsim_app.state.document import Document
from nvsim_app.thresholds.calibrations import Calibrations, cells, sentences, status
from nvsim_app.thresholds.threshold_preview import ThresholdPreview

_CURVE_TIPS = {
    "validity": "Share of the accepted corridors that are free, with its 95 % interval; the dashed line is required",
    "kept": "Share of all corridors that are accepted, and share of the floor that the graph covers",
}
_ENOUGH = 20  # accepted corridors; with fewer, the interval is too wide to set the range of the plot


class CalibrationPlot(QWidget):
    """Two plots over the values of one threshold, 0 to 1. A line marks the current value of the slider."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.plots = {name: Plot(words, self) for name, words in _CURVE_TIPS.items()}
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        for name, plot in self.plots.items():
            plot.setToolTip(tooltip_text(_CURVE_TIPS[name]))
            plot.setXRange(0, 1, padding=0.04)
            layout.addWidget(plot)
        band = [pg.PlotDataItem(), pg.PlotDataItem()]
        tone = QColor(colors.NODE)
        tone.setAlpha(70)
        self._band = pg.FillBetweenItem(*band, brush=tone)
        self._ends = band
        self.plots["validity"].addItem(self._band)
        self.curves = {
            "validity": self.plots["validity"].plot(pen=pg.mkPen(colors.NODE, width=2)),
            "share": self.plots["kept"].plot(pen=pg.mkPen(colors.TRAJECTORY, width=2)),
            "coverage": self.plots["kept"].plot(pen=pg.mkPen(colors.OPEN, width=2)),
        }
        self._want = pg.InfiniteLine(angle=0, pen=pg.mkPen(colors.UNDECIDED, style=Qt.PenStyle.DashLine))
        self.plots["validity"].addItem(self._want)
        self.now, self.suggested = ([self._mark(plot, kind) for plot in self.plots.values()] for kind in (0, 1))
        self._apply_palette()

    def _mark(self, plot: pg.PlotWidget, kind: int) -> pg.InfiniteLine:
        tone, words = (self.palette().text().color(), "now") if kind == 0 else (QColor(colors.WARNING), "suggested")
        style = Qt.PenStyle.SolidLine if kind == 0 else Qt.PenStyle.DashLine
        line = pg.InfiniteLine(
            pen=pg.mkPen(tone, width=1.6, style=style),
            label=words,
            labelOpts={"position": 0.1 + 0.12 * kind, "color": tone, "movable": False},
        )
        plot.addItem(line)
        return line

    def show_rows(self, rows: Sequence[dict[str, Any]], suffix: str, want: float) -> None:
        """Draws the rows of a sweep. `suffix` selects the figures, "" for a point or "_robot"; `want` is required."""
        shown = [row for row in rows if row["accepted"]]  # without accepted corridors there is no validity
        self.curves["validity"].setData(_column(shown, "threshold"), _column(shown, "validity" + suffix))
        for end, name in zip(self._ends, ("low", "high"), strict=True):
            end.setData(_column(shown, "threshold"), _column(shown, name + suffix))
        for name in ("share", "coverage"):
            self.curves[name].setData(_column(rows, "threshold"), _column(rows, name))
        lowest = min([0.9, *(row["low" + suffix] for row in shown if row["accepted"] >= _ENOUGH)])
        self.plots["validity"].setYRange(np.floor(lowest * 10) / 10, 1.0, padding=0.03)
        self.plots["kept"].setYRange(0.0, 1.0, padding=0.03)
        self._want.setValue(want)

    def show_marks(self, now: float, suggested: float | None) -> None:
        """Marks the current value and the suggested value."""
        for line in self.now:
            _place_line(line, now)
        for line in self.suggested:
            line.setVisible(suggested is not None)
            if suggested is not None:
                _place_line(line, suggested)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._apply_palette()
        super().changeEvent(event)

    def _apply_palette(self) -> None:
        palette = self.palette()
        # Long titles would make a narrow plot wider than its space.
        size, ink = title_size(), palette.text().color()
        self.plots["validity"].setTitle("free", size=size, color=ink)
        self.plots["kept"].setTitle(
            f'<span style="color:{plain(colors.TRAJECTORY)}">pass</span>, '
            f'<span style="color:{plain(colors.OPEN)}">covered</span>',
            size=size,
        )
        for line in self.now:
            line.setPen(pg.mkPen(palette.text().color(), width=1.6))
            line.label.setColor(palette.text().color())


def _place_line(line: pg.InfiniteLine, value: float) -> None:
    side = 1.0 if value > 0.5 else 0.0  # so that the label stays inside the plot
    line.label.anchors = [(side, 0.5), (side, 0.5)]
    line.setValue(value)
    line.label.updatePosition()


def _column(rows: Sequence[dict[str, Any]], key: str) -> NDArray[np.float64]:
    return np.array([row[key] for row in rows], np.float64)


_JUDGES: dict[Judge, str] = {"robot": "Free for the robot", "point": "Free for a point"}
_COLUMNS = {
    "Threshold": "",
    "Now": "Current value of the slider",
    "Suggested": "Loosest value whose validity is high enough, with the other thresholds unchanged",
    "Free": "Share of the accepted corridors that are free on the map: now, and with the suggestion",
    "Covered": "Change of the coverage: the share of reachable floor within 2.5 m and in sight of a viewpoint",
    "Edges": "Number of edges that the graph gains or loses",
}
"""Title -> tooltip."""


class CalibrationPanel(QWidget):
    """Shows the calibration of the thresholds. mapWanted(): the user wants to select a map."""

    mapWanted = Signal()

    def __init__(self, calibrations: Calibrations, trial: ThresholdPreview, document: Document) -> None:
        super().__init__()
        self._calibrations, self._trial, self._document = calibrations, trial, document
        self.status, self.words = Label(self), Label(self)
        for label in (self.status, self.words):
            label.setWordWrap(True)
        self.model: TableModel[str] = TableModel(
            [
                Column(title, partial(self._cell, place), tip=words, number=place > 0)
                for place, (title, words) in enumerate(_COLUMNS.items())
            ],
            self,
            dense=True,
        )
        self.list = table(self.model, self, "Thresholds")
        self.list.selectionModel().currentRowChanged.connect(self._show_chosen)
        self.take = push_button("", self, self.apply_suggestion)
        self.plot: CalibrationPlot | None = None  # until there is a result, so that the window opens sooner
        self._lay_out()
        calibrations.changed.connect(self.refresh)
        trial.changed.connect(self._on_trial)
        self.refresh()

    def _lay_out(self) -> None:
        left = QWidget(self)
        controls = self._controls(left)
        about = hbox((self.status, 1), self.frame)
        chosen = hbox((self.words, 1), (self.take, 0, Qt.AlignmentFlag.AlignTop))
        vbox(controls, about, (self.list, 1), chosen, on=left, margins=(8, 4, 8, 4), spacing=4)
        self._split = QSplitter(Qt.Orientation.Horizontal, self)
        self._split.addWidget(left)
        vbox(self._split, on=self, margins=0)

    def _add_plot(self) -> CalibrationPlot:
        plot = CalibrationPlot(self)
        self._split.addWidget(plot)
        self._split.setSizes([480, 500])
        self._split.setStretchFactor(1, 1)
        return plot

    def _controls(self, parent: QWidget) -> QHBoxLayout:
        self.judge = named(QComboBox(parent), "Definition of a free corridor")
        for judge, text in _JUDGES.items():
            self.judge.addItem(text, judge)
        self.judge.setToolTip("A corridor is free if the robot's disc, or only its center, touches no obstacle")
        self.judge.currentIndexChanged.connect(lambda _: self.refresh())
        name, want = "Required share of free corridors", self._calibrations.want
        self.want = NumberBox(name, 0.5, 0.999, want, 3, 0.01, parent=parent)
        self.want.setPrefix("surely ")
        self.want.setToolTip("A value is accepted if the 95 % interval of its validity begins here or above")
        self.want.valueChanged.connect(self._on_want)
        tip = "Select the occupancy map to compare with: a ROS map.yaml, or an OctoMap .bt or .ot"
        self.map = push_button("Map…", parent, self.mapWanted, tip)
        self.frame = QCheckBox("in the capture's frame", parent)
        self.frame.setToolTip("Transform the selected map as the import transformed the capture")
        self.frame.toggled.connect(self._on_frame)
        tip = "Evaluate the graph with the thresholds of the sliders"
        self.again = push_button("Calculate", parent, lambda: self._calibrations.start(), tip)
        return hbox(self.judge, self.want, self.map, self.again, STRETCH)

    def choose_map(self, path: Path) -> None:
        """Compares with this map, and calculates."""
        self._calibrations.truth = path
        self._calibrations.start()

    def _on_want(self, value: float) -> None:
        self._calibrations.want = round(value, 6)
        self.refresh()

    def _on_frame(self, on: bool) -> None:
        self._calibrations.in_capture = on
        if self._calibrations.truth is not None:
            self._calibrations.start()

    @property
    def chosen(self) -> str:
        """The threshold whose curves are shown; "" if there is none."""
        index = self.list.currentIndex()
        return self.model.row(index.row()) if index.isValid() else ""

    def _cell(self, column: int, field: str) -> str:
        return cells(self._calibrations, field, self._judge)[column]

    @property
    def _judge(self) -> Judge:
        return next(j for j in get_args(Judge) if j == self.judge.currentData())

    @property
    def _suffix(self) -> str:
        return "" if self._judge == "point" else "_robot"

    def apply_suggestion(self) -> None:
        """Moves the slider of the selected threshold to the suggested value."""
        if self.obstacle is None:
            config = self._calibrations.taking(self.chosen, self._judge)
            assert config is not None
            self._trial.set_config(config)

    @property
    def obstacle(self) -> str | None:
        """The reason why no suggestion can be taken; None if one can."""
        if self._calibrations.last_result is None or not self.chosen:
            return "nothing is calculated yet"
        if not self._calibrations.is_of_this_graph:
            return "the graph has changed since this was calculated"
        value = self._calibrations.suggestion(self.chosen, self._judge)["threshold"]
        if value is None:
            return "no value of this threshold is good enough"
        if abs(self._calibrations.value(self.chosen) - value) < 1e-6:
            return "the slider already has the suggested value"
        return None

    # Showing ---------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        found, chosen = self._calibrations.last_result, self.chosen
        self.frame.setVisible(self._calibrations.truth is not None)
        with QSignalBlocker(self.frame):
            self.frame.setChecked(self._calibrations.in_capture)
        self.again.setEnabled(self._document.project is not None and self._document.graph is not None)
        fields = [] if found is None else list(found.sweeps)
        self.model.show(fields)
        self.list.setCurrentIndex(self.model.index(fields.index(chosen) if chosen in fields else 0, 0))
        if found is not None and self.plot is None:
            self.plot = self._add_plot()
        if self.plot is not None:
            self.plot.setVisible(found is not None)
        self._show_chosen()

    def _on_trial(self) -> None:
        self.model.refresh_text()
        self._show_chosen()

    def _show_chosen(self, *_: object) -> None:
        self.status.setText(status(self._calibrations, self._document, self.chosen))
        found, field = self._calibrations.last_result, self.chosen
        obstacle = self.obstacle
        self.take.setEnabled(obstacle is None)
        self.take.setToolTip(
            "Move the slider of this threshold there, without applying it"
            if obstacle is None
            else tooltip_text(f"{obstacle}")
        )
        if found is None or self.plot is None or not field:
            self.words.setText("")
            self.take.setText("Use suggestion")
            return
        value = self._calibrations.suggestion(field, self._judge)["threshold"]
        self.take.setText("Use suggestion" if value is None else f"Use {value:.2f}")
        self.words.setText(sentences(self._calibrations, field, self._judge))
        self.plot.show_rows(found.sweeps[field], self._suffix, found.want)
        self.plot.show_marks(self._calibrations.value(field), value)
