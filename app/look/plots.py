"""The common style of all plots: background and axes in the colors of the theme."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtGui import QPalette

from app.look.metrics import points
from app.look.plain_text import marked


def dress(plot: pg.PlotWidget, palette: QPalette) -> None:
    """Applies the colors of a palette to a plot."""
    plot.setBackground(palette.base().color())
    for side in ("left", "bottom"):
        plot.getAxis(side).setPen(palette.placeholderText().color())
        plot.getAxis(side).setTextPen(palette.text().color())


def title_size() -> str:
    """The size of the title of a plot, for pyqtgraph."""
    return f"{points('text'):g}pt"


def label_axes(plot: pg.PlotWidget, bottom: str, left: str) -> None:
    """Sets the labels of the axes, including the unit."""
    plot.setLabel("bottom", marked(bottom))
    plot.setLabel("left", marked(left))
