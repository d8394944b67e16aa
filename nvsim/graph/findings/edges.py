"""Findings about one edge: they depend on it, its ends, the evidence between them and the context alone; of a steep one
on the edges at its ends as well."""

from __future__ import annotations

import math

from nvsim.graph.findings.context import Context
from nvsim.graph.findings.stairs import flight_slope, slope
from nvsim.graph.findings.types import Finding, Fix, Severity
from nvsim.graph.types import EdgeKey, NavGraph


def is_steep(graph: NavGraph, key: EdgeKey, context: Context) -> bool:
    """Whether the finding about it depends on the edges that climb on from its ends."""
    return slope(graph, key) > context.limits.steep


def about_edge(graph: NavGraph, key: EdgeKey, context: Context) -> list[Finding]:
    """The findings about an edge; none where one of its ends is excluded, since agents do not walk it."""
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
    metres = 0.0 if context.led_around is None else context.led_around(a.position, b.position)
    if metres and not graph.edges[key].reviewed:
        far = f"{metres:.0f} m" if math.isfinite(metres) else "a long way"
        seen = Fix("There is no glass: mark it reviewed", "mark_reviewed", {"edges": [list(key)]})
        words = (
            f"cuts off {far} of the trajectory, and without a scan nobody knows whether a pane of glass stands there"
        )
        add("glass", "warning", words, remove, seen)
    length = math.dist(a.position, b.position)
    if length > limits.long:
        split = Fix("Put a viewpoint in its middle", "split_edge", {"edge": list(key), "share": 0.5})
        add("long", "warning", f"is {length:.1f} m long", split, remove)
    elif limits.near <= length < limits.short:  # nearer ones are a pair that is one place
        merge = Fix("Make them one", "merge_viewpoints", {"ids": list(key)})
        add("short", "warning", f"is {length:.2f} m long", merge, remove)
    if length > 0 and is_steep(graph, key, context) and (rises := flight_slope(graph, key)) > limits.stairs:
        alone = slope(graph, key)
        whole = "" if round(rises) == round(alone) else f", {rises:.0f}° with the edges that climb on from it"
        add("steep", "warning", f"rises by {alone:.0f}°{whole}: no stairs are so steep", remove)
    return found
