"""Find viewpoints that are almost at one position, with buckets as wide as the limit."""

from __future__ import annotations

import math
from collections.abc import Iterable

from nvsim.graph.findings.types import Finding, Fix
from nvsim.graph.types import NavGraph, Viewpoint

_Cell = tuple[int, int]
_Place = tuple[float, float, float]
_NONE: dict[str, _Place] = {}


class Neighbourhood:
    """The included viewpoints by position. Every change must be reported with `put` or `drop`. Buckets are
    two-dimensional, so that a search reads only nine of them, even if an undo restores a thousand viewpoints."""

    def __init__(self, reach: float) -> None:
        """`reach` in meters."""
        self._reach = reach
        self._buckets: dict[_Cell, dict[str, _Place]] = {}
        self._cells: dict[str, _Cell] = {}

    def put(self, viewpoint: Viewpoint) -> None:
        """Add a viewpoint or update its position. An excluded viewpoint is removed."""
        self.drop(viewpoint.id)
        if viewpoint.included:
            x, y, _ = viewpoint.position
            cell = self._cells[viewpoint.id] = (math.floor(x / self._reach), math.floor(y / self._reach))
            self._buckets.setdefault(cell, {})[viewpoint.id] = viewpoint.position

    def drop(self, id: str) -> None:
        cell = self._cells.pop(id, None)
        if cell is not None:
            bucket = self._buckets[cell]
            del bucket[id]
            if not bucket:
                del self._buckets[cell]

    def near(self, id: str) -> list[str]:
        """Return the other viewpoints that are closer to an included viewpoint than the limit."""
        cell = self._cells.get(id)
        if cell is None:
            return []
        i, j = cell
        place, reach, buckets = self._buckets[cell][id], self._reach, self._buckets
        return [
            other
            for beside in ((i + di, j + dj) for di in (-1, 0, 1) for dj in (-1, 0, 1))
            for other, its in buckets.get(beside, _NONE).items()
            if math.dist(its, place) < reach and other != id
        ]

    def around(self, ids: Iterable[str]) -> set[str]:
        """Return `ids` and all viewpoints in the buckets around them, which includes all near ones."""
        found = set(ids)
        cells = {self._cells[id] for id in found & self._cells.keys()}
        for beside in {(i + di, j + dj) for i, j in cells for di in (-1, 0, 1) for dj in (-1, 0, 1)}:
            found.update(self._buckets.get(beside, ()))
        return found


def about_pair(graph: NavGraph, a: Viewpoint, b: Viewpoint) -> Finding:
    """Return the finding that two viewpoints are almost at one position. The order of the two does not matter."""
    a, b = (a, b) if a.id < b.id else (b, a)
    apart = math.dist(a.position, b.position)
    names = f"Viewpoints {graph.short(a.id)} and {graph.short(b.id)}"
    message = f"{names} are {apart:.2f} m apart: they are almost at one position."
    fixes = (
        Fix("Merge them", "merge_viewpoints", {"ids": [a.id, b.id]}),
        Fix("Exclude the second", "include", {"ids": [b.id], "included": False}),
    )
    return Finding("duplicate", "warning", message, (a.id, b.id), fixes=fixes)
