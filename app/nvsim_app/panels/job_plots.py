"""The curves of a training job: loss, PSNR, and Gaussians of each submap, or loss and success of an agent.

The curves of another run are dashed. All curves can be smoothed.
"""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph
from numpy.typing import NDArray
from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QColor, QFontMetricsF, QPen, QResizeEvent, QShowEvent
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from nvsim_app.jobs.history import MetricSeries
from nvsim_app.jobs.queue import JobHandle
from nvsim_app.look import colors
from nvsim_app.look.boxes import vbox
from nvsim_app.look.labels import Label
from nvsim_app.look.theme import Plot

PERIOD = 350  # milliseconds between the drawings of two plots; each takes about 15 ms
NARROWEST = 112  # pixels of a small plot
MOST_DRAWN = 400  # points of a curve; more than there are pixels
MOST_IN_LARGE = 1500
_PLOTS = (
    ("loss", "Loss"),
    ("psnr", "PSNR, dB"),
    ("gaussians", "Gaussians"),
    ("success", "Success on held-out tasks"),
    ("spl", "SPL on held-out tasks"),
)
_LARGE_PLOTS = (*_PLOTS[:2], ("psnr_held_out", "PSNR of the held-out photo, dB"), *_PLOTS[2:])
_UNITS = {
    "loss": "loss",
    "psnr": "PSNR / dB",
    "psnr_held_out": "PSNR / dB",
    "gaussians": "Gaussians",
    "success": "share of episodes",
    "spl": "SPL",
}
"""Labels of the axes of large plots."""
_EXACT = ("gaussians", "psnr_held_out")
"""Plots of values without noise, which are not smoothed."""


def smoothed(values: NDArray[np.float64], weight: float) -> NDArray[np.float64]:
    """(N,) exponential moving average of `values` (N,).

    Each value has `weight` times the weight of the value after it; 0 changes nothing. The sum is divided by the sum of
    the weights, so that the result begins at the first value.
    """
    result = np.empty_like(values)
    total = mass = 0.0
    for i, value in enumerate(values):
        total, mass = weight * total + value, weight * mass + 1.0
        result[i] = total / mass
    return result


class StepAxis(pyqtgraph.AxisItem):
    """An axis of training steps that has only as many numbers as fit."""

    def __init__(self) -> None:
        super().__init__("bottom")
        self.enableAutoSIPrefix(False)

    def tickSpacing(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, float]]:
        """1, 2, or 5 times a power of ten. `size` is the length of the axis in pixels."""
        widest = QFontMetricsF(self.font()).horizontalAdvance(f"{maxVal:.0f}") + 10
        least = max(1.0, (maxVal - minVal) * widest / max(size, 1.0))
        power = 10.0 ** math.floor(math.log10(least))
        return [(next(m * power for m in (1, 2, 5, 10) if m * power >= least), 0.0)]


class JobPlots(QWidget):
    """The curves of one job, and of another one to compare. Draws only while it is visible.

    large  whether the axes have labels and the plots are below each other
    """

    def __init__(self, parent: QWidget | None = None, large: bool = False) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self._other: JobHandle | None = None
        self._submap: int | None = None
        self._weight = 0.0
        self._large = large
        self._rows = _LARGE_PLOTS if large else _PLOTS
        self._drawn: dict[str, object] = {}  # plot -> stamp of its contents
        self._due = [name for name, _ in self._rows]
        self.plots: dict[str, Plot] = {}  # made when there are values, because they delay the start of the window
        self._curves: dict[tuple[str, str, int], pyqtgraph.PlotDataItem] = {}
        self.empty = Label("Plots appear here while a submap or an agent trains.", self, wordWrap=True, quiet=True)
        self.empty.setContentsMargins(8, 8, 8, 8)
        self._row = QWidget(self)
        self._places = QVBoxLayout(self._row) if large else QHBoxLayout(self._row)
        self._places.setContentsMargins(4, 4, 4, 4)
        self._row.hide()
        vbox(self.empty, (self._row, 1), on=self, margins=0)
        self._timer = QTimer(self, singleShot=True, interval=PERIOD)
        self._timer.timeout.connect(self._on_time)

    def _add_plot(self, name: str, title: str) -> None:
        plot = Plot(f"Curve of {title}", self._row, axisItems={"bottom": StepAxis()})
        plot.show_title(title)
        plot.setMinimumWidth(60)
        plot.getAxis("left").setTickDensity(0.7)
        plot.getAxis("left").enableAutoSIPrefix(False)
        plot.showGrid(x=True, y=True, alpha=0.15)
        if self._large:
            plot.label_axes("step", _UNITS[name])
            plot.getAxis("left").setWidth(64)  # so that the step axes of all plots are aligned
            plot.setMinimumHeight(70)
        self.plots[name] = plot
        order = [other for other, _ in self._rows if other in self.plots]
        self._places.insertWidget(order.index(name), plot)

    # Contents ---------------------------------------------------------------------------------------------------

    def show_job(self, handle: JobHandle | None) -> None:
        """Draws the curves of this job; None draws none."""
        self._handle = handle
        self.draw()

    def compare(self, other: JobHandle | None) -> None:
        """Draws the curves of another job too, dashed; None draws none."""
        self._other = other
        self.draw()

    def show_submap(self, submap: int | None) -> None:
        """Draws only the curves of this submap; None draws those of all submaps."""
        self._submap = submap
        self.draw()

    def set_smoothing(self, weight: float) -> None:
        """Draws exponential means with this weight (see `smoothed`), and the measured values faintly behind them."""
        self._weight = weight
        self.draw()

    @property
    def runs(self) -> dict[str, JobHandle]:
        """The displayed jobs, by "run" and "other"."""
        found = {"run": self._handle, "other": self._other}
        return {name: handle for name, handle in found.items() if handle is not None}

    def series(self, name: str) -> dict[tuple[str, int], MetricSeries]:
        """The series of a plot: (run, submap) -> series."""
        return {
            (run, submap): one
            for run, handle in self.runs.items()
            for submap, one in handle.history.series.get(name, {}).items()
            if self._submap is None or submap in (self._submap, -1)
        }

    # Drawing ----------------------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Draws new values after a short delay."""
        if not self._timer.isActive():
            self._timer.start()

    def draw(self) -> None:
        """Draws all plots at once."""
        there = self._fitting()
        for name, title in self._rows:
            if name in there and name not in self.plots:
                self._add_plot(name, title)
        for name, plot in self.plots.items():
            plot.setVisible(name in there)
        self._row.setVisible(bool(there))
        self.empty.setVisible(not there)
        if self.isVisible():
            self._due = [name for name, _ in self._rows]
            for _ in self._rows:
                self._draw_one()

    def _fitting(self) -> set[str]:
        """The plots that have values. Small plots are beside each other, so only the first ones that fit are shown."""
        names = [name for name, _ in self._rows if self.series(name)]
        return set(names if self._large else names[: max(1, self.width() // NARROWEST)])

    def _is_fitted(self) -> bool:
        return self._fitting() == {name for name, plot in self.plots.items() if not plot.isHidden()}

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        if not self._is_fitted():
            self.draw()

    def _on_time(self) -> None:
        """Draws the next plot that has new values."""
        if not self._is_fitted():
            self.draw()
        elif self.isVisible() and any(self._draw_one() for _ in self._rows):
            self._timer.start()

    def _draw_one(self) -> bool:
        """Draws the plot whose turn it is. Returns whether it had new values."""
        name = self._due.pop(0)
        self._due.append(name)
        if name not in self.plots:
            return False
        series = self.series(name)
        numbers = tuple(handle.number for handle in self.runs.values())
        newest = tuple(sorted((*key, s.steps[-1] if s.steps else -1.0) for key, s in series.items()))
        weight = 0.0 if name in _EXACT else self._weight
        stamp = (numbers, weight, newest)
        if stamp == self._drawn.get(name):
            return False
        self._drawn[name] = stamp
        lines = {(run, submap): (one, weight) for (run, submap), one in series.items()}
        if weight:
            lines |= {(f"{run} as measured", submap): (one, 0.0) for (run, submap), one in series.items()}
        for key in [k for k in self._curves if k[0] == name and k[1:] not in lines]:
            self.plots[name].removeItem(self._curves.pop(key))
        for (run, submap), (one, heavy) in sorted(lines.items(), key=lambda line: line[0]):
            if (name, run, submap) not in self._curves:
                self._curves[name, run, submap] = self.plots[name].plot(pen=self._pen(run, submap))
            values = np.array(one.values, float)
            values = smoothed(values, heavy) if heavy else values
            stride = max(1, len(one.steps) // (MOST_IN_LARGE if self._large else MOST_DRAWN))
            self._curves[name, run, submap].setData(np.array(one.steps, float)[::stride], values[::stride])
        return True

    def _pen(self, run: str, submap: int) -> QPen:
        color = QColor(colors.submap_color(submap))
        if run.endswith("as measured"):
            color.setAlpha(70)
        pen: QPen = pyqtgraph.mkPen(color, width=1.6 if self._large and color.alpha() == 255 else 1)
        if run.startswith("other"):
            pen.setStyle(Qt.PenStyle.DashLine)
        return pen

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.draw()
