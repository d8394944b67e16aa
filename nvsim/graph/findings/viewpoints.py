"""Findings about one viewpoint or about two at almost one position. They depend only on the viewpoints, their edges and
the context."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable

from nvsim.graph.findings.context import Context
from nvsim.graph.findings.types import Finding, Fix
from nvsim.graph.types import NavGraph, Viewpoint

_USABLE = re.compile(r"[^/\\\s]+")


def about_viewpoint(graph: NavGraph, viewpoint: Viewpoint, context: Context) -> list[Finding]:
    """Return the findings about a viewpoint. For an excluded viewpoint, only its id and its entry are checked, because
    they are still written to files."""
    found = []
    if problem := _id_problem(viewpoint.id):
        new = hashlib.blake2b(viewpoint.id.encode("utf-8", "surrogatepass"), digest_size=16).hexdigest()
        fix = Fix("Give it a new id", "rename_viewpoint", {"old": viewpoint.id, "new": new})
        message = f"The id {viewpoint.id!r} {problem}."
        found.append(Finding("id", "error", message, (viewpoint.id,), fixes=(fix,)))
    id, name = viewpoint.id, graph.short(viewpoint.id)
    for kind, message in context.entries.get(id, ()):
        if not viewpoint.reviewed:
            review = Fix("Correct it when saving", "mark_reviewed", {"viewpoints": [id]})
            found.append(Finding(kind, "error", f"The entry of {name} {message}.", (id,), fixes=(review,)))
    if not viewpoint.included:
        return found
    leave, remove = _leave(id), Fix("Remove it", "remove_viewpoints", {"ids": [id]})
    if not any(graph.viewpoints[other].included for other in graph.neighbours(id)):
        message = f"Viewpoint {name} has no edge: agents cannot find it in the graph."
        found.append(Finding("isolated", "error", message, (id,), fixes=(leave, remove)))
    x, y, z = viewpoint.position
    if context.in_obstacle(x, y):
        message = f"Viewpoint {name} is in an occupied part of the map."
        found.append(Finding("obstacle", "error", message, (id,), fixes=(leave, remove)))
    if context.floor is not None:
        floor = context.floor(x, y, z)
        off = z - viewpoint.height - floor
        if math.isfinite(floor) and abs(off) > context.limits.off_floor:
            where = "above" if off > 0 else "below"
            message = f"Viewpoint {name} would be {abs(off):.2f} m {where} the floor."
            onto = Fix("Move it to the floor", "shift_viewpoints", {"ids": [id], "by": [0.0, 0.0, round(-off, 4)]})
            found.append(Finding("floor", "warning", message, (id,), fixes=(onto,)))
    if viewpoint.submap in context.untrained or (context.images is not None and id not in context.images):
        why = ""
        if viewpoint.submap in context.untrained:
            why = ": no model is trained" if viewpoint.submap < 0 else f": submap {viewpoint.submap} is not trained"
        message = f"Viewpoint {name} has no panorama{why}."
        found.append(Finding("panorama", "warning", message, (id,), fixes=(leave, remove)))
    share = viewpoint.photographed
    if share is not None and share < context.photographed:
        message = f"Only {100 * share:.0f} % of the directions around viewpoint {name} are photographed."
        found.append(Finding("photographed", "warning", message, (id,), fixes=(leave, remove)))
    taken = context.taken.get(id) if context.images is not None and id in context.images else None
    if taken is not None and (away := math.dist(taken, viewpoint.position)) > context.limits.moved:
        message = f"Viewpoint {name} was moved {away:.2f} m away from the position of its image."
        back = Fix("Move it back", "move_viewpoints", {"positions": {id: list(taken)}})
        found.append(Finding("moved", "warning", message, (id,), fixes=(back,)))
    return found


def _leave(id: str) -> Fix:
    return Fix("Exclude it", "include", {"ids": [id], "included": False})


def _id_problem(id: str) -> str:
    if _USABLE.fullmatch(id):
        return ""
    if not id:
        return "is empty"
    if "/" in id or "\\" in id:
        return "has a slash, so no image file can have its name"
    if any(c.isspace() for c in id):
        return "has white space, at which agents split keys"
    return ""


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
