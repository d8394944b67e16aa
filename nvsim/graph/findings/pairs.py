"""Viewpoints that are nearly one place, found by buckets as wide as the limit."""

from __future__ import annotations

import math
from collections.abc import Iterator

from nvsim.graph.findings.types import Finding, Fix
from nvsim.graph.findings.viewpoints import short
from nvsim.graph.types import Viewpoint

_Cell = tuple[int, int, int]


class Neighbourhood:
    """The included viewpoints by place; it must be told of every change."""

    def __init__(self, reach: float) -> None:
        """`reach` in metres."""
        self._reach = reach
        self._buckets: dict[_Cell, dict[str, Viewpoint]] = {}
        self._cells: dict[str, _Cell] = {}

    def put(self, viewpoint: Viewpoint) -> None:
        """Adds it, or takes its new place; an excluded one goes."""
        self.drop(viewpoint.id)
        if viewpoint.included:
            cell = self._cell(viewpoint)
            self._cells[viewpoint.id] = cell
            self._buckets.setdefault(cell, {})[viewpoint.id] = viewpoint

    def drop(self, id: str) -> None:
        cell = self._cells.pop(id, None)
        if cell is not None:
            bucket = self._buckets[cell]
            del bucket[id]
            if not bucket:
                del self._buckets[cell]

    def near(self, viewpoint: Viewpoint) -> Iterator[Viewpoint]:
        """Others that are closer to an included viewpoint than the limit."""
        if viewpoint.id not in self._cells:
            return
        x, y, z = self._cells[viewpoint.id]
        for i in (x - 1, x, x + 1):
            for j in (y - 1, y, y + 1):
                for k in (z - 1, z, z + 1):
                    for other in self._buckets.get((i, j, k), {}).values():
                        apart = math.dist(other.position, viewpoint.position)
                        if other.id != viewpoint.id and apart < self._reach:
                            yield other

    def _cell(self, viewpoint: Viewpoint) -> _Cell:
        x, y, z = (math.floor(value / self._reach) for value in viewpoint.position)
        return x, y, z


def about_pair(a: Viewpoint, b: Viewpoint) -> Finding:
    """The finding that two viewpoints are nearly one place; the same in either order."""
    a, b = (a, b) if a.id < b.id else (b, a)
    apart = math.dist(a.position, b.position)
    message = f"Viewpoints {short(a.id)} and {short(b.id)} are {apart:.2f} m apart: they are nearly the same place."
    fixes = (
        Fix("Make them one", "merge_viewpoints", {"ids": [a.id, b.id]}),
        Fix("Exclude the second", "include", {"ids": [b.id], "included": False}),
    )
    return Finding("duplicate", "warning", message, (a.id, b.id), fixes=fixes)
