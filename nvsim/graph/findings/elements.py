"""Findings about one edge, about one viewpoint, or about two viewpoints at almost one position.

Findings about a viewpoint depend only on viewpoints, their edges and the context. Findings about an edge depend only on
the edge, its ends, the evidence between them and the context. Those about a steep edge also depend on the edges at its
ends: viewpoints on stairs are on single steps, so one edge is often steeper than the flight it belongs to.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable

from nvsim.graph.findings.context import Context, Finding, Fix, Severity
from nvsim.graph.types import EdgeKey, NavGraph, Viewpoint


def is_steep(graph: NavGraph, key: EdgeKey, context: Context) -> bool:
    """Whether the edge is steep, so that its finding also depends on the edges that continue the climb."""
    return slope(graph, key) > context.limits.steep


def about_edge(graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
    """Return the findings about an edge. Returns none if an end is excluded, because agents do not use such edges."""
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    if not (a.included and b.included):
        return []
    limits = context.limits
    names = f"The edge between {graph.short(a.id)} and {graph.short(b.id)}"
    remove = Fix("Remove the edge", "remove_edges", {"pairs": [list(key)]})
    found = []

    def add(kind: str, severity: Severity, message: str, *fixes: Fix) -> None:
        found.append(Finding(kind, severity, f"{names} {message}.", key, (key,), fixes))

    if key in context.one_way and not graph.edges[key].reviewed:
        both = Fix("Make it two-way", "mark_reviewed", {"edges": [list(key)]})
        add("one_way", "error", "goes one way only in the file, which agents refuse", remove, both)
    if context.crosses_obstacle(a.position, b.position):
        add("occupied", "error", "crosses an occupied part of the map", remove)
    if context.against is not None:
        if graph.edges[key].reviewed:
            pass  # a user checked the edge
        elif why := context.against(graph, key):
            review = Fix("Mark as reviewed (edge is correct)", "mark_reviewed", {"edges": [list(key)]})
            add("evidence", "warning", f"contradicts the evidence: {why}", remove, review)
    why = "" if context.possible_glass is None else context.possible_glass(a.position, b.position)
    if why and not graph.edges[key].reviewed:
        seen = Fix("Mark as reviewed (no glass here)", "mark_reviewed", {"edges": [list(key)]})
        words = f"{why}, and without a LiDAR scan a glass pane on the edge cannot be excluded"
        add("glass", "warning", words, remove, seen)
    length = math.dist(a.position, b.position)
    if length > limits.long:
        split = Fix("Add a viewpoint in the middle", "split_edge", {"edge": list(key), "share": 0.5})
        add("long", "warning", f"is {length:.1f} m long", split, remove)
    elif limits.near <= length < limits.short:  # closer viewpoints get the finding about almost one position
        merge = Fix("Merge them", "merge_viewpoints", {"ids": list(key)})
        add("short", "warning", f"is {length:.2f} m long", merge, remove)
    if length > 0 and is_steep(graph, key, context) and (rises := flight_slope(graph, key)) > limits.stairs:
        alone = slope(graph, key)
        whole = "" if round(rises) == round(alone) else f", {rises:.0f}° with the edges that continue the climb"
        add("steep", "warning", f"rises by {alone:.0f}°{whole}: stairs are not that steep", remove)
    return found


_CLIMBS = 0.1  # minimum rise in meters of an edge of a flight


def slope(graph: NavGraph, key: EdgeKey) -> float:
    """Return the degrees between the horizontal and the line from floor to floor."""
    rise, run = _rise_and_distance(graph.viewpoints[key[0]], graph.viewpoints[key[1]])
    return math.degrees(math.atan2(abs(rise), run))


def flight_slope(graph: NavGraph, key: EdgeKey) -> float:
    """Return the slope in degrees of an edge together with two adjoining edges: the one that climbs most from its upper
    end, and the one that descends most from its lower end. Without such edges, it is the slope of the edge alone."""
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    rise, run = _rise_and_distance(a, b)
    low, high = (a, b) if rise >= 0 else (b, a)
    rise = abs(rise)
    for end, before, sign in ((high, low, 1.0), (low, high, -1.0)):
        ways = [
            _rise_and_distance(end, graph.viewpoints[id])
            for id in graph.neighbors(end.id)
            if id != before.id and graph.viewpoints[id].included
        ]
        up, along = max(((sign * r, n) for r, n in ways), default=(0.0, 0.0))
        if up > _CLIMBS:
            rise, run = rise + up, run + along
    return math.degrees(math.atan2(rise, run))


def _rise_and_distance(a: Viewpoint, b: Viewpoint) -> tuple[float, float]:
    """Rise of the floor from a to b, and distance between them seen from above, meters."""
    rise = (b.position[2] - b.height) - (a.position[2] - a.height)
    return rise, math.hypot(b.position[0] - a.position[0], b.position[1] - a.position[1])


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
    leave, remove = _exclude_fix(id), Fix("Remove it", "remove_viewpoints", {"ids": [id]})
    if not any(graph.viewpoints[other].included for other in graph.neighbors(id)):
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


def _exclude_fix(id: str) -> Fix:
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


class Neighborhood:
    """The included viewpoints by position. Every change must be reported with `set_viewpoint` or `remove_viewpoint`.
    Buckets are two-dimensional, so that a search reads only nine of them, even if an undo restores a thousand
    viewpoints."""

    def __init__(self, reach: float) -> None:
        """`reach` in meters."""
        self._reach = reach
        self._buckets: dict[_Cell, dict[str, _Place]] = {}
        self._cells: dict[str, _Cell] = {}

    def set_viewpoint(self, viewpoint: Viewpoint) -> None:
        """Add a viewpoint or update its position. An excluded viewpoint is removed."""
        self.remove_viewpoint(viewpoint.id)
        if viewpoint.included:
            x, y, _ = viewpoint.position
            cell = self._cells[viewpoint.id] = (math.floor(x / self._reach), math.floor(y / self._reach))
            self._buckets.setdefault(cell, {})[viewpoint.id] = viewpoint.position

    def remove_viewpoint(self, id: str) -> None:
        cell = self._cells.pop(id, None)
        if cell is not None:
            bucket = self._buckets[cell]
            del bucket[id]
            if not bucket:
                del self._buckets[cell]

    def close_viewpoints(self, id: str) -> list[str]:
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
