"""Findings about one edge. They depend only on the edge, its ends, the evidence between them and the context. Findings
about a steep edge also depend on the edges at its ends: viewpoints on stairs are on single steps, so one edge is often
steeper than the flight it belongs to."""

from __future__ import annotations

import math

from nvsim.graph.findings.context import Context
from nvsim.graph.findings.types import Finding, Fix, Severity
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
    metres = 0.0 if context.detour_between is None else context.detour_between(a.position, b.position)
    if metres and not graph.edges[key].reviewed:
        far = f"{metres:.0f} m" if math.isfinite(metres) else "a long part"
        seen = Fix("Mark as reviewed (no glass here)", "mark_reviewed", {"edges": [list(key)]})
        words = f"skips {far} of the trajectory, and without a LiDAR scan a glass pane on the edge cannot be excluded"
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
    rise, run = _way(graph.viewpoints[key[0]], graph.viewpoints[key[1]])
    return math.degrees(math.atan2(abs(rise), run))


def flight_slope(graph: NavGraph, key: EdgeKey) -> float:
    """Return the slope in degrees of an edge together with two adjoining edges: the one that climbs most from its upper
    end, and the one that descends most from its lower end. Without such edges, it is the slope of the edge alone."""
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    rise, run = _way(a, b)
    low, high = (a, b) if rise >= 0 else (b, a)
    rise = abs(rise)
    for end, before, sign in ((high, low, 1.0), (low, high, -1.0)):
        ways = [
            _way(end, graph.viewpoints[id])
            for id in graph.neighbours(end.id)
            if id != before.id and graph.viewpoints[id].included
        ]
        up, along = max(((sign * r, n) for r, n in ways), default=(0.0, 0.0))
        if up > _CLIMBS:
            rise, run = rise + up, run + along
    return math.degrees(math.atan2(rise, run))


def _way(a: Viewpoint, b: Viewpoint) -> tuple[float, float]:
    """Rise of the floor from a to b, and distance between them seen from above, meters."""
    rise = (b.position[2] - b.height) - (a.position[2] - a.height)
    return rise, math.hypot(b.position[0] - a.position[0], b.position[1] - a.position[1])
