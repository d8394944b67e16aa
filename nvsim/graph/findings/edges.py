"""Findings about one edge: they depend on it, its ends, the evidence between them and the context alone."""

from __future__ import annotations

import math

from nvsim.graph.findings.context import Context
from nvsim.graph.findings.types import Finding, Fix, Severity
from nvsim.graph.findings.viewpoints import short
from nvsim.graph.types import EdgeKey, NavGraph


def about_edge(graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
    """The findings about an edge; none where one of its ends is excluded, since agents do not walk it."""
    a, b = graph.viewpoints[key[0]], graph.viewpoints[key[1]]
    if not (a.included and b.included):
        return []
    limits = context.limits
    names = f"The edge between {short(a.id)} and {short(b.id)}"
    remove = Fix("Remove the edge", "remove_edges", {"pairs": [list(key)]})
    found = []

    def add(kind: str, severity: Severity, message: str, *fixes: Fix) -> None:
        found.append(Finding(kind, severity, f"{names} {message}.", key, (key,), fixes))

    if key in context.one_way and not graph.edges[key].reviewed:
        both = Fix("Let it go both ways", "mark_reviewed", {"edges": [list(key)]})
        add("one_way", "error", "goes one way only in the file, which agents refuse", remove, both)
    if context.crosses_obstacle(a.position, b.position):
        add("occupied", "error", "leads through what the map calls occupied", remove)
    if context.against is not None:
        if graph.edges[key].reviewed:
            pass  # a user has seen it and let it be
        elif why := context.against(graph, key):
            review = Fix("It is right: mark it reviewed", "mark_reviewed", {"edges": [list(key)]})
            add("evidence", "warning", f"stands against the evidence: {why}", remove, review)
    length = math.dist(a.position, b.position)
    if length > limits.long:
        split = Fix("Put a viewpoint in its middle", "split_edge", {"edge": list(key), "share": 0.5})
        add("long", "warning", f"is {length:.1f} m long", split, remove)
    elif length < limits.short:
        merge = Fix("Make them one", "merge_viewpoints", {"ids": list(key)})
        add("short", "warning", f"is {length:.2f} m long", merge, remove)
    rise = abs(a.position[2] - a.height - b.position[2] + b.height)
    run = math.hypot(a.position[0] - b.position[0], a.position[1] - b.position[1])
    slope = math.degrees(math.atan2(rise, run))
    if length > 0 and slope > limits.steep:
        add("steep", "warning", f"rises by {slope:.0f}°", remove)
    return found
