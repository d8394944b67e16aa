"""Add, replace and remove given viewpoints and edges: the edit for changes without a name of their own."""

from __future__ import annotations

from collections.abc import Iterable

from nvsim.graph.edits.change import Change, key_of, need_number, need_place, unique
from nvsim.graph.edits.viewpoints import need_id
from nvsim.graph.types import Edge, EdgeKey, NavGraph, Viewpoint


def patch(
    graph: NavGraph,
    viewpoints: Iterable[Viewpoint] = (),
    edges: Iterable[Edge] = (),
    no_viewpoints: Iterable[str] = (),
    no_edges: Iterable[EdgeKey] = (),
) -> NavGraph:
    """First remove edges and viewpoints. Then add the given ones, or replace those with equal ids or ends. Raises
    EditError if an element to remove or an end does not exist, or if an element is locked."""
    change = Change(graph)
    for a, b in unique(key_of(*pair) for pair in no_edges):
        change.drop_edge(a, b)
    gone = unique(no_viewpoints)
    if gone:
        change.drop(*gone)
    for viewpoint in viewpoints:
        need_id(viewpoint.id)
        need_place(viewpoint.position)
        need_number(viewpoint.height, "The height above the floor")
        change.put(viewpoint)
    for edge in edges:
        a, b = key_of(edge.a, edge.b)
        change.put_edge(Edge(a, b, edge.origin, edge.reviewed, edge.locked))
    return change.done()
