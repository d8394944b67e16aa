"""Viewpoints and edges are marked as reviewed or locked, findings as ignored."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from nvsim.graph.edits.change import Change, EditError, unique
from nvsim.graph.types import EdgeKey, NavGraph


def mark_reviewed(
    graph: NavGraph, viewpoints: Iterable[str] = (), edges: Iterable[EdgeKey] = (), reviewed: bool = True
) -> NavGraph:
    """A user looked at them and found them right, or takes that back. Raises EditError when one is not there."""
    change = Change(graph)
    for id in unique(viewpoints):
        change.put(replace(change.viewpoint(id), reviewed=reviewed))
    for pair in unique(edges):
        change.put_edge(replace(change.edge(*pair), reviewed=reviewed))
    return change.done()


def set_locked(
    graph: NavGraph, viewpoints: Iterable[str] = (), edges: Iterable[EdgeKey] = (), locked: bool = True
) -> NavGraph:
    """Edits refuse to move, change or remove what is locked; it can still be marked as reviewed, and a locked viewpoint
    be joined. Raises EditError when one is not there."""
    change = Change(graph)
    for id in unique(viewpoints):
        change.put(replace(change.viewpoint(id), locked=locked))
    for pair in unique(edges):
        change.put_edge(replace(change.edge(*pair), locked=locked))
    return change.done()


def ignore_finding(graph: NavGraph, key: str, reason: str) -> NavGraph:
    """The finding of this key is not shown again, for this reason. Raises EditError when no reason is given."""
    if not key or not reason.strip():
        raise EditError("A finding is ignored for a reason; give one.")
    change = Change(graph)
    change.ignore(key, reason.strip())
    return change.done()


def heed_finding(graph: NavGraph, key: str) -> NavGraph:
    """The finding of this key is shown again. Raises EditError when it was not ignored."""
    if key not in graph.ignored:
        raise EditError(f"The finding {key} is not ignored.")
    change = Change(graph)
    change.ignore(key, None)
    return change.done()
