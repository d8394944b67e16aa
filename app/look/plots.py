"""What all plots share: the ground and the axes are those of the theme."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtGui import QPalette


def dress(plot: pg.PlotWidget, palette: QPalette) -> None:
    """Gives a plot the colours of a palette."""
    plot.setBackground(palette.base().color())
    for side in ("left", "bottom"):
        plot.getAxis(side).setPen(palette.placeholderText().color())
        plot.getAxis(side).setTextPen(palette.text().color())
