"""The stairs as boxes: solid steps, and the cut edge of the floor above."""

from __future__ import annotations

from nvsim.building.flight import Flight
from nvsim.building.plan import HEIGHT, INNER_WALL, Rect
from nvsim.building.solids import TOP, Box, Paint

_RISER = Paint("plain", (0.74, 0.72, 0.68))
_TREADS = Paint("wood", (0.50, 0.36, 0.24)), Paint("wood", (0.58, 0.43, 0.29))


def stair_boxes(flight: Flight, walls: Paint) -> list[Box]:
    """The steps, whose tops are treads, and the edge of the opening. The edge has the paint of the surrounding `walls`,
    but the last riser that of the steps."""
    steps = [
        Box((g.x0, g.y0, 0.0), (g.x1, g.y1, height), _RISER, ((TOP, _TREADS[i % 2]),), tread=True)
        for i, (g, height) in enumerate(flight.treads())
    ]
    hole, wide = flight.rect, flight.rect.grown(INNER_WALL)
    edges = (
        Rect(wide.x0, wide.y0, hole.x0, wide.y1),
        Rect(hole.x1, wide.y0, wide.x1, wide.y1),
        Rect(hole.x0, wide.y0, hole.x1, hole.y0),
        Rect(hole.x0, hole.y1, hole.x1, wide.y1),
    )
    return steps + [
        Box((e.x0, e.y0, HEIGHT), (e.x1, e.y1, flight.climb), _RISER if e.grown(1e-3).contains(*flight.head) else walls)
        for e in edges
    ]
