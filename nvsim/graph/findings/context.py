"""The context that the findings of a graph depend on: limits, a map, floors, images, evidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from nvsim.graph.edits.edges import Visible
from nvsim.graph.types import EdgeKey, NavGraph
from nvsim.occupancy.types import OccupancyMap


@dataclass(frozen=True)
class Limits:
    """Meters and degrees. Real R2R edges are 0.3 to 5 m long, with few beyond."""

    near: float = 0.25
    """Viewpoints closer than this are nearly one place."""
    neighbours: float = 1.5
    """Viewpoints closer than this, without a known obstacle between them, need a short path between them."""
    detour: float = 3.0
    """Meters along the graph from which such a path is too long (R2R's success distance)."""
    long: float = 5.0
    """Edges longer than this are reported."""
    short: float = 0.25
    """Edges shorter than this are reported."""
    steep: float = 35.0
    """Degrees between an edge and the horizontal. Steeper edges must be part of stairs, which have about 32."""
    stairs: float = 45.0
    """Degrees between stairs and the horizontal, over several edges. Steeper stairs are reported."""
    off_floor: float = 0.3
    """Meters from the floor to the foot of a viewpoint, its position less its height. More is reported."""
    moved: float = 0.05
    """Meters between a viewpoint and the position of its image. More is reported."""


@dataclass(frozen=True, eq=False)
class Context:
    """Everything may be missing; what is missing is not checked.

    occupancy   a map; only cells known to be occupied are held against a graph, unknown ones are not
    against     (graph, edge) -> why the stored evidence speaks against the edge, in words that end a sentence; "" when
                it does not
    closed      (graph, pair of viewpoints without an edge) -> whether the stored evidence speaks against one
    led_around  (x, y, z of one camera, of another) -> metres along the trajectory between them where that leads far
                around the straight way; 0 where it does not. Asked where no scan would show a pane of glass
    visible     who sees whom by the lists of a foreign file; others are not said to be near
    floor       (x, y, near z) -> height of the floor there, metres, NaN where it is unknown
    images      ids of the viewpoints that have a panorama
    taken       id -> x, y, z metres where those panoramas were taken; where they are drawn as needed there are none
    untrained   submaps without a model, whose viewpoints cannot be drawn; -1 among them where there is no model at all
    one_way     edges that a foreign file lists in one direction only
    entries     id -> what is wrong with its entry in a foreign file: (kind, words that end a sentence)
    """

    limits: Limits = field(default_factory=Limits)
    occupancy: OccupancyMap | None = None
    against: Callable[[NavGraph, EdgeKey], str] | None = None
    closed: Callable[[NavGraph, EdgeKey], bool] | None = None
    led_around: Callable[[tuple[float, ...], tuple[float, ...]], float] | None = None
    visible: Visible | None = None
    floor: Callable[[float, float, float], float] | None = None
    images: frozenset[str] | None = None
    taken: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    untrained: frozenset[int] = frozenset()
    one_way: frozenset[EdgeKey] = frozenset()
    entries: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)

    def in_obstacle(self, x: float, y: float) -> bool:
        """Whether the place lies in an occupied cell."""
        return self.occupancy is not None and self._room_at(*self._cell(x, y)) == 0.0

    def crosses_obstacle(self, a: tuple[float, ...], b: tuple[float, ...]) -> bool:
        """Whether the straight way from a to b, seen from above, meets an occupied cell. As much is passed over at once
        as is known to be open around."""
        if self.occupancy is None:
            return False
        (x0, y0), (x1, y1) = self._cell(a[0], a[1]), self._cell(b[0], b[1])
        length, along = math.hypot(x1 - x0, y1 - y0), 0.0
        while along <= length:
            share = along / length if length else 0.0
            room = self._room_at(x0 + share * (x1 - x0), y0 + share * (y1 - y0))
            if room == 0.0:
                return True
            # The nearest occupied cell begins up to 1.5 diagonals before the distance between the centres.
            along += max(room - 1.5, 0.25)
        return False

    def _cell(self, x: float, y: float) -> tuple[float, float]:
        """Column and row, not rounded."""
        assert self.occupancy is not None
        scale, (left, low) = 1.0 / self.occupancy.resolution, self.occupancy.origin
        return (x - left) * scale, (y - low) * scale

    def _room_at(self, column: float, row: float) -> float:
        rows, columns = self._shape
        if not (0 <= row < rows and 0 <= column < columns):
            # Nothing is known outside, and it is at least as far to the map.
            return max(1.0, math.hypot(max(-column, column - columns, 0.0), max(-row, row - rows, 0.0)))
        assert self.occupancy is not None
        return float(self.occupancy.room.item(int(row), int(column)))

    @cached_property
    def _shape(self) -> tuple[int, int]:
        assert self.occupancy is not None
        rows, columns = self.occupancy.cells.shape
        return rows, columns
