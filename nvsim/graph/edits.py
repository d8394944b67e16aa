"""Edits: each one function from a graph to a graph. What a person adds or moves carries the origin "person"."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from nvsim.graph.types import Edge, NavGraph, Viewpoint, edge


class EditError(Exception):
    """The edit is impossible on this graph; the message is one sentence that says why."""


def add_viewpoint(graph: NavGraph, viewpoint: Viewpoint) -> NavGraph:
    """A viewpoint without edges, at the end. Raises EditError when its id is taken or unusable."""
    if viewpoint.id in graph.viewpoints:
        raise EditError(f"There already is a viewpoint {viewpoint.id}.")
    if not viewpoint.id or "/" in viewpoint.id:
        raise EditError(f"{viewpoint.id!r} cannot be the id of a viewpoint.")
    _need_finite(viewpoint.position)
    return replace(graph, viewpoints={**graph.viewpoints, viewpoint.id: viewpoint})


def remove_viewpoints(graph: NavGraph, ids: Iterable[str]) -> NavGraph:
    """The viewpoints go, and with them their edges and all evidence measured from them or towards them.

    Raises EditError when one of them is not there.
    """
    gone = set(ids)
    for id in sorted(gone):
        _need(graph, id)
    return replace(
        graph,
        viewpoints={id: v for id, v in graph.viewpoints.items() if id not in gone},
        edges={key: e for key, e in graph.edges.items() if not gone.intersection(key)},
        evidence={k: e for k, e in graph.evidence.items() if e.viewpoint not in gone and e.joins not in gone},
    )


def add_edge(graph: NavGraph, a: str, b: str, origin: str = "person") -> NavGraph:
    """An edge between two viewpoints, at the end. Raises EditError when one is missing or they are joined already."""
    _need(graph, a)
    _need(graph, b)
    if a == b:
        raise EditError("A viewpoint cannot be joined to itself.")
    new = edge(a, b, origin)
    if new.key in graph.edges:
        raise EditError(f"The viewpoints {a} and {b} are already joined.")
    return replace(graph, edges={**graph.edges, new.key: new})


def remove_edge(graph: NavGraph, a: str, b: str) -> NavGraph:
    """The edge goes; the evidence behind it stays. Raises EditError when there is none."""
    key = (min(a, b), max(a, b))
    if key not in graph.edges:
        raise EditError(f"The viewpoints {a} and {b} are not joined.")
    return replace(graph, edges={k: e for k, e in graph.edges.items() if k != key})


def move_viewpoint(graph: NavGraph, id: str, position: tuple[float, float, float]) -> NavGraph:
    """The viewpoint stands elsewhere, at the same height above its floor. It and its edges become a person's, and the
    evidence measured from or towards its old place goes. Raises EditError when it is missing."""
    _need(graph, id)
    _need_finite(position)
    moved = replace(graph.viewpoints[id], position=position, origin="person")
    edges: dict[tuple[str, str], Edge] = {
        key: replace(e, origin="person") if id in key else e for key, e in graph.edges.items()
    }
    return replace(
        graph,
        viewpoints={k: moved if k == id else v for k, v in graph.viewpoints.items()},
        edges=edges,
        evidence={k: e for k, e in graph.evidence.items() if id not in (e.viewpoint, e.joins)},
    )


def _need(graph: NavGraph, id: str) -> None:
    if id not in graph.viewpoints:
        raise EditError(f"There is no viewpoint {id}.")


def _need_finite(position: tuple[float, float, float]) -> None:
    if len(position) != 3 or not all(math.isfinite(value) for value in position):
        raise EditError(f"{position} is not a place.")
