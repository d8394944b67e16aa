"""Shapes and dashes that tell groups of viewpoints and edges apart without colours, in the window and in figures."""

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
"""Of the shapes that are no disc: x, y in shares of the disc's diameter, from the upper left."""
DASHES: tuple[tuple[float, ...], ...] = ((), (4, 2), (1, 2), (4, 2, 1, 2), (4, 2, 1, 2, 1, 2))
"""Of lines: strokes and gaps in turn, in widths of the line; the first is a line without gaps."""
