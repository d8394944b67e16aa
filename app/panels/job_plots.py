"""Loss, PSNR and number of Gaussians of a training, a line for each submap, as they come."""

from __future__ import annotations

import numpy as np
import pyqtgraph
from PySide6.QtCore import QEvent, QTimer
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QHBoxLayout, QLabel, QVBoxLayout, QWidget

from app import colors
from app.jobs.queue import JobHandle

PERIOD = 700  # milliseconds between two drawings at least
_PLOTS = (("loss", "Loss"), ("psnr", "PSNR, dB"), ("gaussians", "Gaussians"))


class JobPlots(QWidget):
    """Shows the series of one job; draws only while it can be seen."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._handle: JobHandle | None = None
        self._drawn: object = None
        self.plots: dict[str, pyqtgraph.PlotWidget] = {}
        self._curves: dict[tuple[str, int], pyqtgraph.PlotDataItem] = {}
        self.empty = QLabel("Plots appear here while a submap trains.", self)
        self.empty.setForegroundRole(self.empty.palette().ColorRole.PlaceholderText)
        self.empty.setContentsMargins(12, 8, 12, 8)
        self._row = QWidget(self)
        row = QHBoxLayout(self._row)
        row.setContentsMargins(2, 2, 2, 2)
        for name, title in _PLOTS:
            plot = pyqtgraph.PlotWidget(self._row)
            plot.setMenuEnabled(False)
            plot.hideButtons()
            plot.setTitle(title, size="9pt")
            plot.setMinimumWidth(90)
            plot.getAxis("bottom").setTickDensity(0.5)
            plot.getAxis("left").setTickDensity(0.7)
            plot.getAxis("left").enableAutoSIPrefix(False)
            plot.getAxis("bottom").enableAutoSIPrefix(False)
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
        self._timer.timeout.connect(self.draw)
        self._dress()

    def show_job(self, handle: JobHandle | None) -> None:
        """Draws that job from now on; None draws nothing."""
        self._handle, self._drawn = handle, None
        self.draw()

    def refresh(self) -> None:
        """Draws what is new, soon."""
        if not self._timer.isActive():
            self._timer.start()

    def draw(self) -> None:
        """Draws what is new, now."""
        series = {} if self._handle is None else self._handle.history.series
        shown = any(name in series for name, _ in _PLOTS)
        self._row.setVisible(shown)
        self.empty.setVisible(not shown)
        if not self.isVisible():
            return
        state = [len(s.steps) and s.steps[-1] for by_submap in series.values() for s in by_submap.values()]
        stamp = (None if self._handle is None else self._handle.number, tuple(state))
        if stamp == self._drawn:
            return
        self._drawn = stamp
        wanted = {(n, s) for n, _ in _PLOTS for s in series.get(n, {})}
        for key in set(self._curves) - wanted:
            self.plots[key[0]].removeItem(self._curves.pop(key))
        for name, submap in sorted(wanted):
            one = series[name][submap]
            if (name, submap) not in self._curves:
                pen = pyqtgraph.mkPen(colors.submap_color(submap), width=1.5)
                self._curves[name, submap] = self.plots[name].plot(pen=pen, name=f"submap {submap}")
            self._curves[name, submap].setData(np.array(one.steps, float), np.array(one.values, float))

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
            plot.setBackground(palette.base().color())
            plot.setTitle(title, size="9pt", color=palette.text().color())
            for side in ("left", "bottom"):
                plot.getAxis(side).setPen(palette.placeholderText().color())
                plot.getAxis(side).setTextPen(palette.text().color())
