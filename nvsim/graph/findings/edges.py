"""Findings about one edge. They depend only on the edge, its ends, the evidence between them and the context. Findings
about a steep edge also depend on the edges at its ends."""

from __future__ import annotations

import math

from nvsim.graph.findings.context import Context
from nvsim.graph.findings.stairs import flight_slope, slope
from nvsim.graph.findings.types import Finding, Fix, Severity
from nvsim.graph.types import EdgeKey, NavGraph


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
