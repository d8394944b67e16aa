"""Curves in panels, as SVG for papers and as PNG for everything else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic

Colour = tuple[int, int, int]  # red, green, blue
_INK, _FAINT, _PAPER = (40, 40, 40), (205, 205, 205), (255, 255, 255)
_SIZE = (300, 170)  # pixels of a plot
_LEFT, _RIGHT, _TOP, _BOTTOM, _LEGEND = 46, 14, 30, 34, 34
_LETTERS = 12  # pixels
_FINE = 2  # pixels of the PNG to one of the SVG


@dataclass(frozen=True, eq=False)
class Curve:
    """name in the legend; x and y (N,); low and high (N,) of a band around it, or None."""

    name: str
    colour: Colour
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    low: NDArray[np.float64] | None = None
    high: NDArray[np.float64] | None = None


@dataclass(frozen=True, eq=False)
class Panel:
    """x runs from 0 to 1, y from `lowest` to 1; what lies below is cut off. marks: places on x with the name that they
    have in the legend and their colour; level: a faint line across, or None."""

    title: str
    curves: Sequence[Curve]
    lowest: float = 0.0
    marks: Sequence[tuple[float, str, Colour]] = ()
    level: float | None = None


class _Paper:
    """The same lines, bands and words as SVG and as pixels. x and y in pixels of the SVG, y downwards."""

    def __init__(self, width: int, height: int) -> None:
        self._rows = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
            f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="{_LETTERS}">',
            f'<rect width="100%" height="100%" fill="{_hex(_PAPER)}"/>',
        ]
        self._pixels = np.full((height * _FINE, width * _FINE, 3), _PAPER, np.uint8)

    def line(self, points: NDArray[np.float64], colour: Colour, width: float = 1.0, dashed: bool = False) -> None:
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        dashes = ' stroke-dasharray="4 3"' if dashed else ""
        self._rows.append(
            f'<polyline points="{path}" fill="none" stroke="{_hex(colour)}" stroke-width="{width:g}"{dashes}/>'
        )
        thick = max(1, round(width * _FINE))
        for a, b in zip(points[:-1], points[1:], strict=True):
            pieces = max(1, round(float(np.hypot(*(b - a))) / 3.5)) if dashed else 1
            for k in range(0, pieces, 2):
                ends = (a + (b - a) * share / pieces for share in (k, k + 1))
                start, stop = (_fixed(end) for end in ends)
                cv2.line(self._pixels, start, stop, colour, thick, cv2.LINE_AA, 4)

    def band(self, points: NDArray[np.float64], colour: Colour) -> None:
        """A closed, faint area."""
        faint = _blend(colour)
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._rows.append(f'<polygon points="{path}" fill="{_hex(faint)}"/>')
        cv2.fillPoly(self._pixels, [np.array([_fixed(p) for p in points])], faint, cv2.LINE_AA, 4)

    def words(self, text: str, x: float, y: float, anchor: float = 0.0, colour: Colour = _INK) -> None:
        """A text whose left end (anchor 0), middle (0.5) or right end (1) is at x, on the base line y."""
        name = {0.0: "start", 0.5: "middle", 1.0: "end"}[anchor]
        self._rows.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{name}" fill="{_hex(colour)}">{escape(text)}</text>'
        )
        scale, font = _FINE * _LETTERS / 30, cv2.FONT_HERSHEY_SIMPLEX
        wide = cv2.getTextSize(text, font, scale, 1)[0][0]
        at = (round(x * _FINE - anchor * wide), round(y * _FINE))
        cv2.putText(self._pixels, text, at, font, scale, colour, 1, cv2.LINE_AA)

    def write(self, path: Path) -> list[Path]:
        files = [path.with_suffix(".svg"), path.with_suffix(".png")]
        atomic.write_text(files[0], "\n".join([*self._rows, "</svg>\n"]))
        atomic.write_bytes(files[1], cv2.imencode(".png", self._pixels[..., ::-1])[1].tobytes())
        return files


def draw_chart(path: Path, rows: Sequence[Sequence[Panel]]) -> list[Path]:
    """Writes `path` with the suffixes .svg and .png: `rows` of panels, and a legend of all that they show. Returns both
    paths. Raises InputError when the disk refuses."""
    wide, high = _LEFT + _SIZE[0] + _RIGHT, _TOP + _SIZE[1] + _BOTTOM
    paper = _Paper(wide * max(len(row) for row in rows), high * len(rows) + _LEGEND)
    for i, row in enumerate(rows):
        for j, panel in enumerate(row):
            _draw(paper, panel, wide * j + _LEFT, high * i + _TOP)
    entries: dict[str, tuple[Colour, bool]] = {}
    for panel in (panel for row in rows for panel in row):
        entries |= {curve.name: (curve.colour, False) for curve in panel.curves}
        entries |= {name: (colour, True) for _, name, colour in panel.marks}
    x, y = float(_LEFT), high * len(rows) + _LEGEND / 2
    for name, (colour, dashed) in entries.items():
        paper.line(np.array([[x, y - 4], [x + 22, y - 4]]), colour, 2.0, dashed)
        paper.words(name, x + 28, y)
        x += 28 + 8.0 * len(name) + 24
    return paper.write(path)


def _draw(paper: _Paper, panel: Panel, left: float, top: float) -> None:
    width, height = _SIZE
    span = max(1.0 - panel.lowest, 1e-9)

    def at(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        share = np.clip((y - panel.lowest) / span, 0.0, 1.0)
        return np.stack([left + np.clip(x, 0.0, 1.0) * width, top + (1.0 - share) * height], axis=-1)

    def across(x0: float, y0: float, x1: float, y1: float) -> NDArray[np.float64]:
        return at(np.array([x0, x1]), np.array([y0, y1]))

    paper.words(panel.title, left, top - 10)
    for curve in panel.curves:
        if curve.low is not None and curve.high is not None:
            there, back = at(curve.x, curve.high), at(curve.x, curve.low)[::-1]
            paper.band(np.concatenate([there, back]), curve.colour)
    for share in np.linspace(0, 1, 5):
        y = panel.lowest + share * span
        paper.line(across(0, y, 1, y), _FAINT)
        paper.words(f"{y:.3g}", left - 6, top + (1 - share) * height + 4, 1.0)
        paper.words(f"{share:g}", left + share * width, top + height + 16, 0.5)
    if panel.level is not None:
        paper.line(across(0, panel.level, 1, panel.level), _INK, 1.0, dashed=True)
    for curve in panel.curves:
        paper.line(at(curve.x, curve.y), curve.colour, 1.6)
    for x, _, colour in panel.marks:
        paper.line(across(x, panel.lowest, x, 1.0), colour, 1.4, dashed=True)


def _fixed(point: NDArray[np.float64]) -> tuple[int, int]:
    """Sixteenths of a pixel: cv2's `shift` of 4."""
    return round(float(point[0]) * _FINE * 16), round(float(point[1]) * _FINE * 16)


def _blend(colour: Colour) -> Colour:
    red, green, blue = (round(0.2 * c + 0.8 * p) for c, p in zip(colour, _PAPER, strict=True))
    return red, green, blue


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
