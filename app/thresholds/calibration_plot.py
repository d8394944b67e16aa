"""The curves of one threshold: the share of accepted corridors that are free, and the share that is accepted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QHBoxLayout, QWidget

from app.look import colors
from app.look.plain_text import plain, tip
from app.look.plots import dress, title_size

_TIPS = {
    "validity": "Share of the accepted corridors that are free, with its 95 % interval; the dashed line is required",
    "kept": "Share of all corridors that are accepted, and share of the floor that the graph covers",
}
_ENOUGH = 20  # accepted corridors; with fewer, the interval is too wide to set the range of the plot


class CalibrationPlot(QWidget):
    """Two plots over the values of one threshold, 0 to 1. A line marks the current value of the slider."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.plots = {name: pg.PlotWidget(self) for name in _TIPS}
        layout = QHBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(4)
        for name, plot in self.plots.items():
            plot.setToolTip(tip(_TIPS[name]))
            plot.setAccessibleName(plain(_TIPS[name]))
            plot.setMenuEnabled(False)
            plot.hideButtons()
            plot.setMouseEnabled(x=False, y=False)
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
        self._dress()

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
            _put(line, now)
        for line in self.suggested:
            line.setVisible(suggested is not None)
            if suggested is not None:
                _put(line, suggested)

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()
        super().changeEvent(event)

    def _dress(self) -> None:
        palette = self.palette()
        # Long titles would make a narrow plot wider than its space.
        size, ink = title_size(), palette.text().color()
        self.plots["validity"].setTitle("free", size=size, color=ink)
        self.plots["kept"].setTitle(
            f'<span style="color:{plain(colors.TRAJECTORY)}">pass</span>, '
            f'<span style="color:{plain(colors.OPEN)}">covered</span>',
            size=size,
        )
        for plot in self.plots.values():
            dress(plot, palette)
        for line in self.now:
            line.setPen(pg.mkPen(palette.text().color(), width=1.6))
            line.label.setColor(palette.text().color())


def _put(line: pg.InfiniteLine, value: float) -> None:
    side = 1.0 if value > 0.5 else 0.0  # so that the label stays inside the plot
    line.label.anchors = [(side, 0.5), (side, 0.5)]
    line.setValue(value)
    line.label.updatePosition()


def _column(rows: Sequence[dict[str, Any]], key: str) -> NDArray[np.float64]:
    return np.array([row[key] for row in rows], np.float64)
