"""A drawing surface for charts that writes SVG for papers and PNG for other uses."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import escape

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.files import atomic

Colour = tuple[int, int, int]
"""Red, green, blue."""
INK, FAINT, PAPER = (40, 40, 40), (205, 205, 205), (255, 255, 255)
LETTERS = 12
"""Height of letters in pixels."""
_FINE = 2  # pixels of the PNG per pixel of the SVG


class ChartCanvas:
    """Draws lines, areas, and text as SVG and as pixels. x and y are in pixels of the SVG, y downwards."""

    def __init__(self, width: int, height: int) -> None:
        self._rows = [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
            f'viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="{LETTERS}">',
            f'<rect width="100%" height="100%" fill="{_hex(PAPER)}"/>',
        ]
        self._pixels = np.full((height * _FINE, width * _FINE, 3), PAPER, np.uint8)

    def line(self, points: NDArray[np.float64], colour: Colour, width: float = 1.0, dashed: bool = False) -> None:
        """A line through points (N, 2), `width` pixels wide."""
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
        """A closed, faint area with corners at points (N, 2)."""
        self.area(points, blended(colour, 0.8))

    def area(self, points: NDArray[np.float64], colour: Colour) -> None:
        """A closed area with corners at points (N, 2)."""
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self._rows.append(f'<polygon points="{path}" fill="{_hex(colour)}"/>')
        cv2.fillPoly(self._pixels, [np.array([_fixed(p) for p in points])], colour, cv2.LINE_AA, 4)

    def words(self, text: str, x: float, y: float, anchor: float = 0.0, colour: Colour = INK) -> None:
        """A text whose left end (anchor 0), center (0.5) or right end (1) is at x, on the baseline y."""
        name = {0.0: "start", 0.5: "middle", 1.0: "end"}[anchor]
        self._rows.append(
            f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{name}" fill="{_hex(colour)}">{escape(text)}</text>'
        )
        scale, font = _FINE * LETTERS / 30, cv2.FONT_HERSHEY_SIMPLEX
        wide = cv2.getTextSize(text, font, scale, 1)[0][0]
        at = (round(x * _FINE - anchor * wide), round(y * _FINE))
        cv2.putText(self._pixels, text, at, font, scale, colour, 1, cv2.LINE_AA)

    def write(self, path: Path) -> list[Path]:
        """Writes `path` with the suffixes .svg and .png; returns both. Raises InputError if the disk refuses."""
        files = [path.with_suffix(".svg"), path.with_suffix(".png")]
        atomic.write_text(files[0], "\n".join([*self._rows, "</svg>\n"]))
        atomic.write_bytes(files[1], cv2.imencode(".png", self._pixels[..., ::-1])[1].tobytes())
        return files


def _fixed(point: NDArray[np.float64]) -> tuple[int, int]:
    """Coordinates in sixteenths of a pixel, for a `shift` of 4 in cv2."""
    return round(float(point[0]) * _FINE * 16), round(float(point[1]) * _FINE * 16)


def blended(colour: Colour, share: float) -> Colour:
    """The color mixed with a share of the paper color."""
    red, green, blue = (round((1 - share) * c + share * p) for c, p in zip(colour, PAPER, strict=True))
    return red, green, blue


def _hex(colour: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
