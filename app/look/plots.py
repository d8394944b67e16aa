"""What all plots share: the ground and the axes are those of the theme."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtGui import QPalette

from app.look.plain_text import marked


def dress(plot: pg.PlotWidget, palette: QPalette) -> None:
    """Gives a plot the colours of a palette."""
    plot.setBackground(palette.base().color())
    for side in ("left", "bottom"):
        plot.getAxis(side).setPen(palette.placeholderText().color())
        plot.getAxis(side).setTextPen(palette.text().color())


def label_axes(plot: pg.PlotWidget, bottom: str, left: str) -> None:
    """Says beside the axes what they measure, with the unit."""
    plot.setLabel("bottom", marked(bottom))
    plot.setLabel("left", marked(left))
