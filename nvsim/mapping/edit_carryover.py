"""Keep a user's edits when a graph is built again."""

from __future__ import annotations

from dataclasses import replace

from nvsim.graph.types import NavGraph


def keep_edits(graph: NavGraph, previous: NavGraph | None) -> NavGraph:
    """Return `graph` with the viewpoints and edges of `previous` that a user made or locked; edges need both ends. The
    marks of unmoved viewpoints, the marks of edges, and ignored findings are kept as well."""
    if previous is None:
        return graph
    viewpoints, edges = dict(graph.viewpoints), dict(graph.edges)
    for id, was in previous.viewpoints.items():
        now = viewpoints.get(id)
        if now is None:
            if was.origin == "person" or was.locked:
                viewpoints[id] = was
        elif now.position == was.position and (was.reviewed or was.locked):
            viewpoints[id] = replace(now, reviewed=was.reviewed, locked=was.locked)
    for key, held in previous.edges.items():
        found = edges.get(key)
        if found is None:
            if (held.origin == "person" or held.locked) and all(end in viewpoints for end in key):
                edges[key] = held
        elif held.reviewed or held.locked:
            edges[key] = replace(found, reviewed=held.reviewed, locked=held.locked)
    return NavGraph(graph.scan, viewpoints, edges, graph.evidence, previous.ignored)
