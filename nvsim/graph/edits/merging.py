"""Merge viewpoints into one."""

from __future__ import annotations

from collections.abc import Iterable

from nvsim.graph.edits.change import Change, EditError, Place, key_of, unique
from nvsim.graph.edits.moving import move_in
from nvsim.graph.types import NavGraph, edge


def merge_viewpoints(graph: NavGraph, ids: Iterable[str], into: str | None = None, middle: bool = False) -> NavGraph:
    """Merge viewpoints into `into`, by default the first of them. It takes over the edges to other viewpoints. It keeps
    its position, or moves to the mean position of all with `middle`. Its existing edges stay, and the evidence of
    removed viewpoints is deleted.

    Raises EditError if there are fewer than two, or if one does not exist, is locked, or has a locked edge.
    """
    names = unique(ids)
    kept = names[0] if into is None and names else into
    if kept is None or len({*names, kept}) < 2:
        raise EditError("Merging needs at least two viewpoints.")
    change = Change(graph)
    gone = [id for id in names if id != kept]
    places = [change.viewpoint(id).position for id in unique((kept, *gone))]
    others = unique(other for id in gone for other in change.neighbours(id) if other != kept and other not in gone)
    change.drop(*gone)
    if middle:
        move_in(change, kept, _mean(places))
    for other in others:
        if key_of(kept, other) not in change.edges:
            change.put_edge(edge(kept, other, "person"))
    return change.done()


def _mean(places: list[Place]) -> Place:
    x, y, z = (sum(values) / len(places) for values in zip(*places, strict=True))
    return x, y, z
