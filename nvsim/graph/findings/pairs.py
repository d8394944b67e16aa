"""Viewpoints that are nearly one place, found by buckets as wide as the limit."""

from __future__ import annotations

import math
from collections.abc import Iterable

from nvsim.graph.findings.types import Finding, Fix
from nvsim.graph.types import NavGraph, Viewpoint

_Cell = tuple[int, int]
_Place = tuple[float, float, float]
_NONE: dict[str, _Place] = {}


class Neighbourhood:
    """The included viewpoints by place; it must be told of every change. Buckets stand on the ground, so that nine are
    looked into: a thousand viewpoints may come back at once."""

    def __init__(self, reach: float) -> None:
        """`reach` in metres."""
        self._reach = reach
        self._buckets: dict[_Cell, dict[str, _Place]] = {}
        self._cells: dict[str, _Cell] = {}

    def put(self, viewpoint: Viewpoint) -> None:
        """Adds it, or takes its new place; an excluded one goes."""
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
        """Others that are closer to an included viewpoint than the limit."""
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
        """`ids`, and everything in the buckets around them: more than is near."""
        found = set(ids)
        cells = {self._cells[id] for id in found & self._cells.keys()}
        for beside in {(i + di, j + dj) for i, j in cells for di in (-1, 0, 1) for dj in (-1, 0, 1)}:
            found.update(self._buckets.get(beside, ()))
        return found


def about_pair(graph: NavGraph, a: Viewpoint, b: Viewpoint) -> Finding:
    """The finding that two viewpoints are nearly one place; the same in either order."""
    a, b = (a, b) if a.id < b.id else (b, a)
    apart = math.dist(a.position, b.position)
    names = f"Viewpoints {graph.short(a.id)} and {graph.short(b.id)}"
    message = f"{names} are {apart:.2f} m apart: they are nearly the same place."
    fixes = (
        Fix("Make them one", "merge_viewpoints", {"ids": [a.id, b.id]}),
        Fix("Exclude the second", "include", {"ids": [b.id], "included": False}),
    )
    return Finding("duplicate", "warning", message, (a.id, b.id), fixes=fixes)
