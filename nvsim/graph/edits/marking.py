"""Mark viewpoints and edges as reviewed or locked, and findings as ignored."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from nvsim.graph.edits.change import Change, EditError, unique
from nvsim.graph.types import EdgeKey, NavGraph


def mark_reviewed(
    graph: NavGraph, viewpoints: Iterable[str] = (), edges: Iterable[EdgeKey] = (), reviewed: bool = True
) -> NavGraph:
    """Mark elements as checked by a user and correct, or remove this mark. Raises EditError if one does not exist."""
    change = Change(graph)
    for id in unique(viewpoints):
        change.set_viewpoint(replace(change.viewpoint(id), reviewed=reviewed))
    for pair in unique(edges):
        change.set_edge(replace(change.edge(*pair), reviewed=reviewed))
    return change.done()


def set_locked(
    graph: NavGraph, viewpoints: Iterable[str] = (), edges: Iterable[EdgeKey] = (), locked: bool = True
) -> NavGraph:
    """Lock or unlock elements. Edits refuse to move, change or remove a locked element. It can still be marked as
    reviewed, and a locked viewpoint can be joined. Raises EditError if an element does not exist."""
    change = Change(graph)
    for id in unique(viewpoints):
        change.set_viewpoint(replace(change.viewpoint(id), locked=locked))
    for pair in unique(edges):
        change.set_edge(replace(change.edge(*pair), locked=locked))
    return change.done()


def ignore_finding(graph: NavGraph, key: str, reason: str) -> NavGraph:
    """Hide the finding of this key, for a reason. Raises EditError if the key or the reason is empty."""
    if not key or not reason.strip():
        raise EditError("A finding is only ignored for a reason; give one.")
    change = Change(graph)
    change.ignore(key, reason.strip())
    return change.done()


def heed_finding(graph: NavGraph, key: str) -> NavGraph:
    """Show an ignored finding again. Raises EditError if it is not ignored."""
    if key not in graph.ignored:
        raise EditError(f"The finding {key} is not ignored.")
    change = Change(graph)
    change.ignore(key, None)
    return change.done()
