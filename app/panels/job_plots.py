"""Loss, PSNR and Gaussians of a training, a line for each submap, as they come; loss and success of an agent."""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph
from PySide6.QtCore import QEvent, QTimer
from PySide6.QtGui import QFontMetricsF, QShowEvent
from PySide6.QtWidgets import QHBoxLayout, QVBoxLayout, QWidget

from app.jobs.queue import JobHandle
from app.look import colors
from app.look.labels import Label
from app.look.plain_text import marked
from app.look.plots import dress

PERIOD = 350  # milliseconds between the drawings of two plots: one at a time, as each takes some 15 ms
MOST_DRAWN = 400  # points of a line; more than there are pixels
_PLOTS = (
    ("loss", "Loss"),
    ("psnr", "PSNR, dB"),
    ("gaussians", "Gaussians"),
    ("success", "Success on what is held out"),
    ("spl", "SPL on what is held out"),
)


class StepAxis(pyqtgraph.AxisItem):
    """Numbers of steps, only as many as have room beside each other."""

    def __init__(self) -> None:
        super().__init__("bottom")
        self.enableAutoSIPrefix(False)

    def tickSpacing(self, minVal: float, maxVal: float, size: float) -> list[tuple[float, float]]:
        """1, 2 or 5 times a power of ten; `size` is the length of the axis in pixels."""
        widest = QFontMetricsF(self.font()).horizontalAdvance(f"{maxVal:.0f}") + 10
        least = max(1.0, (maxVal - minVal) * widest / max(size, 1.0))
        power = 10.0 ** math.floor(math.log10(least))
        return [(next(m * power for m in (1, 2, 5, 10) if m * power >= least), 0.0)]


class JobPlots(QWidget):
    """Shows the series of one job; draws only while it can be seen."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self._drawn: dict[str, object] = {}  # plot -> what it shows
        self._due = [name for name, _ in _PLOTS]
        self.plots: dict[str, pyqtgraph.PlotWidget] = {}
        self._curves: dict[tuple[str, int], pyqtgraph.PlotDataItem] = {}
        self.empty = Label("Plots appear here while a submap or an agent trains.", self)
        self.empty.setForegroundRole(self.empty.palette().ColorRole.PlaceholderText)
        self.empty.setContentsMargins(12, 8, 12, 8)
        self._row = QWidget(self)
        row = QHBoxLayout(self._row)
        row.setContentsMargins(2, 2, 2, 2)
        for name, title in _PLOTS:
            plot = pyqtgraph.PlotWidget(self._row, axisItems={"bottom": StepAxis()})
            plot.setAccessibleName(f"Curve of {title}")
            plot.setMenuEnabled(False)
            plot.hideButtons()
            plot.setTitle(marked(title), size="9pt")
            plot.setMinimumWidth(60)
            plot.getAxis("left").setTickDensity(0.7)
            plot.getAxis("left").enableAutoSIPrefix(False)
            plot.showGrid(x=True, y=True, alpha=0.15)
            plot.setMouseEnabled(x=False, y=False)
            self.plots[name] = plot
            row.addWidget(plot)
        self._row.hide()
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.empty)
        layout.addWidget(self._row, 1)
        self._timer = QTimer(self, singleShot=True, interval=PERIOD)
        self._timer.timeout.connect(self._on_time)
        self._dress()

    def show_job(self, handle: JobHandle | None) -> None:
        """Draws that job from now on; None draws nothing."""
        self._handle = handle
        self.draw()

    def refresh(self) -> None:
        """Draws what is new, soon."""
        if not self._timer.isActive():
            self._timer.start()

    def draw(self) -> None:
        """Draws everything now."""
        series = {} if self._handle is None else self._handle.history.series
        shown = any(name in series for name, _ in _PLOTS)
        for name, plot in self.plots.items():
            plot.setVisible(name in series)
        self._row.setVisible(shown)
        self.empty.setVisible(not shown)
        if self.isVisible():
            self._due = [name for name, _ in _PLOTS]
            for _ in _PLOTS:
                self._draw_one()

    def _on_time(self) -> None:
        """Draws the next plot that has something new."""
        series = {} if self._handle is None else self._handle.history.series
        if any(self.plots[name].isHidden() == (name in series) for name, _ in _PLOTS):
            self.draw()
        elif self.isVisible() and any(self._draw_one() for _ in _PLOTS):
            self._timer.start()

    def _draw_one(self) -> bool:
        """Draws the plot whose turn it is; says whether there was anything new."""
        name = self._due.pop(0)
        self._due.append(name)
        series = {} if self._handle is None else self._handle.history.series.get(name, {})
        number = None if self._handle is None else self._handle.number
        stamp = (number, tuple(sorted((submap, s.steps[-1] if s.steps else -1.0) for submap, s in series.items())))
        if stamp == self._drawn.get(name):
            return False
        self._drawn[name] = stamp
        for key in [k for k in self._curves if k[0] == name and k[1] not in series]:
            self.plots[name].removeItem(self._curves.pop(key))
        for submap, one in sorted(series.items()):
            if (name, submap) not in self._curves:
                pen = pyqtgraph.mkPen(colors.submap_color(submap), width=1)
                self._curves[name, submap] = self.plots[name].plot(pen=pen, name=f"submap {submap}")
            stride = max(1, len(one.steps) // MOST_DRAWN)
            steps, values = np.array(one.steps[::stride], float), np.array(one.values[::stride], float)
            self._curves[name, submap].setData(steps, values)
        return True

    def showEvent(self, event: QShowEvent) -> None:
        super().showEvent(event)
        self.draw()

    def changeEvent(self, event: QEvent) -> None:
        if event.type() == QEvent.Type.PaletteChange:
            self._dress()
        super().changeEvent(event)

    def _dress(self) -> None:
        palette = self.palette()
        for (_, title), plot in zip(_PLOTS, self.plots.values(), strict=True):
            dress(plot, palette)
            plot.setTitle(marked(title), size="9pt", color=palette.text().color())
