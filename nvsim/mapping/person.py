"""What a person did to a graph, carried over when the machine decides again."""

from __future__ import annotations

from nvsim.graph.types import NavGraph


def keep_edits(graph: NavGraph, previous: NavGraph | None) -> NavGraph:
    """`graph` with the viewpoints and edges of `previous` that a person made, as far as their ends still exist."""
    if previous is None:
        return graph
    viewpoints = dict(graph.viewpoints)
    for id, viewpoint in previous.viewpoints.items():
        if viewpoint.origin == "person":
            viewpoints.setdefault(id, viewpoint)
    edges = dict(graph.edges)
    for key, edge in previous.edges.items():
        if edge.origin == "person" and all(end in viewpoints for end in key):
            edges.setdefault(key, edge)
    return NavGraph(graph.scan, viewpoints, edges, graph.evidence)
