"""Compute all findings of a graph from scratch. `Validator` must give equal results."""

from __future__ import annotations

from nvsim.errors import InputError
from nvsim.graph.components import components
from nvsim.graph.connectivity import check_scan_id
from nvsim.graph.edits.change import key_of
from nvsim.graph.findings.context import Context
from nvsim.graph.findings.detours import about_detour
from nvsim.graph.findings.edges import about_edge
from nvsim.graph.findings.pairs import Neighbourhood, about_pair
from nvsim.graph.findings.types import SEVERITIES, Finding, Fix
from nvsim.graph.findings.viewpoints import about_viewpoint
from nvsim.graph.types import NavGraph

_NOTHING = Context()


def check_graph(graph: NavGraph, context: Context = _NOTHING) -> list[Finding]:
    """Return all findings, the most severe first, otherwise in the order of the graph. Findings that a user ignores are
    included."""
    found = about_graph(graph)
    for viewpoint in graph.viewpoints.values():
        found += about_viewpoint(graph, viewpoint, context)
    groups = [group for group in components(graph) if len(group) > 1]
    groups.sort(key=lambda group: (-len(group), min(group)))
    for group in groups[1:]:
        ids = tuple(sorted(group))
        message = f"{len(ids)} viewpoints around {graph.short(ids[0])} cannot be reached from the others."
        fixes = (Fix("Exclude them", "include", {"ids": list(ids), "included": False}),)
        found.append(Finding("island", "warning", message, ids, fixes=fixes))
    places, beside = Neighbourhood(context.limits.near), Neighbourhood(context.limits.neighbours)
    for viewpoint in graph.viewpoints.values():
        places.put(viewpoint)
        beside.put(viewpoint)
        found += [about_pair(graph, viewpoint, graph.viewpoints[other]) for other in places.near(viewpoint.id)]
        for other in beside.near(viewpoint.id):
            found += about_detour(graph, key_of(viewpoint.id, other), context)
    for key in graph.edges:
        found += about_edge(graph, key, context)
    return sorted(found, key=lambda f: SEVERITIES.index(f.severity))


def about_graph(graph: NavGraph) -> list[Finding]:
    """Return the findings about the graph as a whole that need no search."""
    found = []
    try:
        check_scan_id(graph.scan)
    except InputError as error:
        found.append(Finding("scan", "error", str(error)))
    if not any(v.included for v in graph.viewpoints.values()):
        found.append(Finding("empty", "error", "No viewpoint is included: agents cannot stand anywhere."))
    return found
