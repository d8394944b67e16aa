"""Add and remove edges, one or many at once. Mark elements as reviewed or locked, and findings as ignored."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits.change import Change, EditError, key_of, need_number, unique
from nvsim.graph.types import EdgeKey, EdgeOrigin, NavGraph, edge

Visible = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]
"""Line of sight from positions a (N, 3) to positions b (N, 3), meters, world: (N,) bool."""


def add_edge(graph: NavGraph, a: str, b: str, origin: EdgeOrigin = "person") -> NavGraph:
    """Add an edge between two viewpoints, at the end. Raises EditError if one does not exist or they are already
    joined."""
    return add_edges(graph, [(a, b)], origin)


def add_edges(graph: NavGraph, pairs: Iterable[EdgeKey], origin: EdgeOrigin = "person") -> NavGraph:
    """Add an edge for each pair of ids, at the end. Raises EditError if a viewpoint does not exist or a pair is already
    joined."""
    change = Change(graph)
    for a, b in pairs:
        if a == b:
            raise EditError("A viewpoint cannot be joined to itself.")
        if key_of(a, b) in change.edges:
            raise EditError(f"The viewpoints {a} and {b} are already joined.")
        change.set_edge(edge(a, b, origin))
    return change.result()


def remove_edge(graph: NavGraph, a: str, b: str) -> NavGraph:
    """Remove an edge; its evidence stays. Raises EditError if it does not exist or is locked."""
    return remove_edges(graph, [(a, b)])


def remove_edges(graph: NavGraph, pairs: Iterable[EdgeKey]) -> NavGraph:
    """Remove edges; their evidence stays. Raises EditError if one does not exist or is locked."""
    change = Change(graph)
    for a, b in unique(key_of(*pair) for pair in pairs):
        change.remove_edge(a, b)
    return change.result()


def connect_visible(
    graph: NavGraph, ids: Iterable[str], distance: float, visible: Visible | None = None, *, steep: float = 45.0
) -> NavGraph:
    """Add an edge between all pairs of the viewpoints that are at most `distance` meters apart and see each other. The
    slope is at most `steep` degrees, which prevents edges between floors. Existing edges do not change, and excluded
    viewpoints are skipped.

    Without `visible`, all pairs count as visible. Raises EditError if a viewpoint does not exist or the distance is not
    positive.
    """
    from scipy.spatial import cKDTree

    distance = need_number(distance, "The distance", positive=True)
    change = Change(graph)
    names = [id for id in unique(ids) if change.viewpoint(id).included]
    if len(names) < 2:
        return graph
    places = np.array([graph.viewpoints[id].position for id in names])
    pairs = cKDTree(places).query_pairs(distance, output_type="ndarray")
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    a, b = places[pairs[:, 0]], places[pairs[:, 1]]
    rise, run = np.abs(b[:, 2] - a[:, 2]), np.hypot(*(b - a)[:, :2].T)
    open = (rise <= math.tan(math.radians(steep)) * run) & (rise + run > 0)
    open &= np.array([key_of(names[i], names[j]) not in graph.edges for i, j in pairs.tolist()], bool)
    if visible is not None and open.any():
        open[open] = visible(a[open], b[open])
    for i, j in pairs[open].tolist():
        change.set_edge(edge(names[i], names[j], "person"))
    return change.result()


def mark_reviewed(
    graph: NavGraph, viewpoints: Iterable[str] = (), edges: Iterable[EdgeKey] = (), reviewed: bool = True
) -> NavGraph:
    """Mark elements as checked by a user and correct, or remove this mark. Raises EditError if one does not exist."""
    return _with_mark(graph, viewpoints, edges, reviewed=reviewed)


def set_locked(
    graph: NavGraph, viewpoints: Iterable[str] = (), edges: Iterable[EdgeKey] = (), locked: bool = True
) -> NavGraph:
    """Lock or unlock elements. Edits refuse to move, change or remove a locked element. It can still be marked as
    reviewed, and a locked viewpoint can be joined. Raises EditError if an element does not exist."""
    return _with_mark(graph, viewpoints, edges, locked=locked)


def _with_mark(graph: NavGraph, viewpoints: Iterable[str], edges: Iterable[EdgeKey], **mark: bool) -> NavGraph:
    change = Change(graph)
    for id in unique(viewpoints):
        change.set_viewpoint(replace(change.viewpoint(id), **mark))  # type: ignore[arg-type]
    for pair in unique(edges):
        change.set_edge(replace(change.edge(*pair), **mark))  # type: ignore[arg-type]
    return change.result()


def ignore_finding(graph: NavGraph, key: str, reason: str) -> NavGraph:
    """Hide the finding of this key, for a reason. Raises EditError if the key or the reason is empty."""
    if not key or not reason.strip():
        raise EditError("A finding is only ignored for a reason; give one.")
    change = Change(graph)
    change.ignore(key, reason.strip())
    return change.result()


def heed_finding(graph: NavGraph, key: str) -> NavGraph:
    """Show an ignored finding again. Raises EditError if it is not ignored."""
    if key not in graph.ignored:
        raise EditError(f"The finding {key} is not ignored.")
    change = Change(graph)
    change.ignore(key, None)
    return change.result()
