"""A finding, and the inputs of the findings of a graph: limits, a map, floors, images, evidence."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, get_args

from nvsim.graph.edits.edges import Visible
from nvsim.graph.types import EdgeKey, NavGraph
from nvsim.occupancy.types import OccupancyMap

Severity = Literal["error", "warning", "notice"]
"""error: agents fail or collide. warning: probably wrong. notice: worth a look."""
SEVERITIES: tuple[Severity, ...] = get_args(Severity)
BLOCKS_EXPORT = frozenset({"scan", "id", "empty", "isolated", "one_way", "length"})
"""Kinds that break the programs which read the files. An export with such a finding is refused."""


@dataclass(frozen=True)
class Fix:
    """An edit that could fix a finding.

    text        label of the button
    operation   name in the table of operations
    arguments   its arguments, JSON values
    """

    text: str
    operation: str
    arguments: Mapping[str, Any] = field(hash=False)


@dataclass(frozen=True)
class Finding:
    """A problem of a graph.

    kind        "scan", "empty", "id", "isolated", "island", "duplicate", "detour", "obstacle", "floor", "panorama",
                "photographed", "occupied", "evidence", "glass", "long", "short", "steep"; for a foreign file also
                "moved", "one_way", "self" and "length"
    severity    one of SEVERITIES
    message     one sentence
    viewpoints  affected ids
    edges       affected keys
    fixes       edits that could fix it, the likeliest first
    """

    kind: str
    severity: Severity
    message: str
    viewpoints: tuple[str, ...] = ()
    edges: tuple[EdgeKey, ...] = ()
    fixes: tuple[Fix, ...] = ()

    @property
    def key(self) -> str:
        """A key that stays equal while the finding exists. Ignored findings are stored by this key."""
        names = self.viewpoints[:1] if self.kind == "island" else self.viewpoints
        return "/".join((self.kind, *names))

    @property
    def kind_key(self) -> str:
        """The key that ignores all findings of this kind in a graph."""
        return f"{self.kind}/*"

    def ignored_by(self, ignored: Mapping[str, str]) -> str | None:
        """Return the key in `ignored` that ignores this finding or its kind; None if there is none."""
        return next((key for key in (self.key, self.kind_key) if key in ignored), None)


@dataclass(frozen=True)
class Limits:
    """Limits in meters and degrees. Most R2R edges are 0.3 to 5 m long."""

    near: float = 0.25
    """Viewpoints closer than this many meters are almost at one position."""
    neighbors: float = 1.5
    """Viewpoints closer than this many meters should have a short path between them, unless something is known to be
    between them."""
    detour: float = 3.0
    """A path along the graph is long if it exceeds this many meters (R2R's success distance)."""
    long: float = 5.0
    """Edges longer than this many meters are reported."""
    short: float = 0.25
    """Edges shorter than this many meters are reported."""
    steep: float = 35.0
    """Degrees between an edge and the horizontal above which the edge must be part of stairs. Stairs have about 32
    degrees."""
    stairs: float = 45.0
    """Degrees that stairs may have at most, measured over several edges."""
    off_floor: float = 0.3
    """Maximum difference in meters between the height of a viewpoint and its height above the floor."""
    moved: float = 0.05
    """Maximum distance in meters of a viewpoint from the position of its image."""


@dataclass(frozen=True, eq=False)
class Context:
    """Information that findings depend on. Every part is optional; checks without their information are skipped.

    limits      see `Limits`
    occupancy   a map; only cells known to be occupied count as obstacles, unknown cells do not
    against     (graph, edge) -> why the stored evidence contradicts the edge, as the end of a sentence; "" if it does
                not
    closed      (graph, pair of viewpoints without an edge) -> whether the stored evidence contradicts an edge
    possible_glass  (x, y, z of one camera, of another) -> why a glass pane may be between them, a clause without its
                subject; "" if none may be there. Set if there is no LiDAR scan that would show a pane
    visible     line of sight by the lists of a foreign file; viewpoints that do not see each other get no detour
                finding
    floor       (x, y, near z) -> height of the floor there, meters; NaN if it is unknown
    images      ids of the viewpoints that have a panorama
    taken       id -> x, y, z meters where that panorama was taken; empty if panoramas are rendered on demand
    photographed  photographed share below which a viewpoint is reported; 0 for none
    untrained   submaps without a model, whose viewpoints cannot be rendered; contains -1 if there is no model at all
    one_way     edges that a foreign file lists in one direction only
    entries     id -> faults of its entry in a foreign file: (kind, end of a sentence)
    """

    limits: Limits = field(default_factory=Limits)
    occupancy: OccupancyMap | None = None
    against: Callable[[NavGraph, EdgeKey], str] | None = None
    closed: Callable[[NavGraph, EdgeKey], bool] | None = None
    possible_glass: Callable[[tuple[float, ...], tuple[float, ...]], str] | None = None
    visible: Visible | None = None
    floor: Callable[[float, float, float], float] | None = None
    images: frozenset[str] | None = None
    taken: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    photographed: float = 0.0
    untrained: frozenset[int] = frozenset()
    one_way: frozenset[EdgeKey] = frozenset()
    entries: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)

    def in_obstacle(self, x: float, y: float) -> bool:
        """Whether a position is in an occupied cell."""
        return self.occupancy is not None and self._room_at(*self._cell(x, y)) == 0.0

    def crosses_obstacle(self, a: tuple[float, ...], b: tuple[float, ...]) -> bool:
        """Whether the straight line from a to b, seen from above, crosses an occupied cell. The test skips distances
        that are known to be open."""
        if self.occupancy is None:
            return False
        (x0, y0), (x1, y1) = self._cell(a[0], a[1]), self._cell(b[0], b[1])
        length, along = math.hypot(x1 - x0, y1 - y0), 0.0
        while along <= length:
            share = along / length if length else 0.0
            room = self._room_at(x0 + share * (x1 - x0), y0 + share * (y1 - y0))
            if room == 0.0:
                return True
            # `room` is measured between cell centers; the occupied cell can begin up to 1.5 cells earlier.
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
            # Nothing is known outside the map. The nearest obstacle is at least as far as the map.
            return max(1.0, math.hypot(max(-column, column - columns, 0.0), max(-row, row - rows, 0.0)))
        assert self.occupancy is not None
        return float(self.occupancy.room.item(int(row), int(column)))

    @cached_property
    def _shape(self) -> tuple[int, int]:
        assert self.occupancy is not None
        rows, columns = self.occupancy.cells.shape
        return rows, columns
