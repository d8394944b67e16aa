"""Draw curves in panels, as SVG for papers and as PNG for other uses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.evaluation.chart_canvas import FAINT, INK, ChartCanvas, Colour

_SIZE = (300, 170)  # pixels of a plot
_LEFT, _RIGHT, _TOP, _BOTTOM, _LEGEND = 46, 14, 30, 34, 34


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve: its name in the legend, x and y (N,), and low and high (N,) of a band around it, or None."""

    name: str
    colour: Colour
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    low: NDArray[np.float64] | None = None
    high: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """A plot with x from 0 to 1 and y from `lowest` to 1. Values outside are clipped. marks: vertical lines as x, name
    in the legend, and color; level: y of a faint horizontal line, or None."""

    title: str
    curves: Sequence[Curve]
    lowest: float = 0.0
    marks: Sequence[tuple[float, str, Colour]] = ()
    level: float | None = None


def draw_chart(path: Path, rows: Sequence[Sequence[Panel]]) -> list[Path]:
    """Writes `path` with the suffixes .svg and .png: `rows` of panels, and a legend. Returns both paths. Raises
    InputError if the disk refuses."""
    wide, high = _LEFT + _SIZE[0] + _RIGHT, _TOP + _SIZE[1] + _BOTTOM
    canvas = ChartCanvas(wide * max(len(row) for row in rows), high * len(rows) + _LEGEND)
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            _draw(canvas, panel, wide * j + _LEFT, high * i + _TOP)
    entries: dict[str, tuple[Colour, bool]] = {}
    for panel in (panel for row in rows for panel in row):
        entries |= {curve.name: (curve.colour, False) for curve in panel.curves}
        entries |= {name: (colour, True) for _, name, colour in panel.marks}
    x, y = float(_LEFT), high * len(rows) + _LEGEND / 2
    for name, (colour, dashed) in entries.items():
        canvas.line(np.array([[x, y - 4], [x + 22, y - 4]]), colour, 2.0, dashed)
        canvas.words(name, x + 28, y)
        x += 28 + 8.0 * len(name) + 24
    return canvas.write(path)


def _draw(canvas: ChartCanvas, panel: Panel, left: float, top: float) -> None:
    width, height = _SIZE
    span = max(1.0 - panel.lowest, 1e-9)

    def at(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        share = np.clip((y - panel.lowest) / span, 0.0, 1.0)
        return np.stack([left + np.clip(x, 0.0, 1.0) * width, top + (1.0 - share) * height], axis=-1)

    def across(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.float64]:
        return at(np.array([x0, x1]), np.array([y0, y1]))

    canvas.words(panel.title, left, top - 10)
    for curve in panel.curves:
        if curve.low is not None and curve.high is not None:
            there, back = at(curve.x, curve.high), at(curve.x, curve.low)[::-1]
            canvas.band(np.concatenate([there, back]), curve.colour)
    for share in np.linspace(0, 1, 5):
        y = panel.lowest + share * span
        canvas.line(across(0, y, 1, y), FAINT)
        canvas.words(f"{y:.3g}", left - 6, top + (1 - share) * height + 4, 1.0)
        canvas.words(f"{share:g}", left + share * width, top + height + 16, 0.5)
    if panel.level is not None:
        canvas.line(across(0, panel.level, 1, panel.level), INK, 1.0, dashed=True)
    for curve in panel.curves:
        canvas.line(at(curve.x, curve.y), curve.colour, 1.6)
    for x, _, colour in panel.marks:
        canvas.line(across(x, panel.lowest, x, 1.0), colour, 1.4, dashed=True)
