"""Shapes and dashes that distinguish groups of viewpoints and edges without color, in the window and in figures."""

from __future__ import annotations

SHAPES = ("disc", "square", "diamond", "triangle", "point", "cross")
CORNERS = {
    "square": ((0.06, 0.06), (0.94, 0.06), (0.94, 0.94), (0.06, 0.94)),
    "diamond": ((0.5, -0.04), (1.04, 0.5), (0.5, 1.04), (-0.04, 0.5)),
    "triangle": ((0.5, -0.02), (1.04, 0.96), (-0.04, 0.96)),
    "point": ((0.5, 1.02), (1.04, 0.04), (-0.04, 0.04)),
    "cross": ((0.3, 0.0), (0.7, 0.0), (0.7, 0.3), (1.0, 0.3), (1.0, 0.7), (0.7, 0.7),
              (0.7, 1.0), (0.3, 1.0), (0.3, 0.7), (0.0, 0.7), (0.0, 0.3), (0.3, 0.3)),
}  # fmt: skip
"""Corners of the shapes other than the disc: x, y as shares of the disc's diameter, from the upper left."""
DASHES: tuple[tuple[float, ...], ...] = ((), (4, 2), (1, 2), (4, 2, 1, 2), (4, 2, 1, 2, 1, 2))
"""Dash patterns of lines: lengths of strokes and gaps in turn, in line widths. The first pattern is a solid line."""
