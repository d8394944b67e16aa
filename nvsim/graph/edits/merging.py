"""Several viewpoints become one."""

from __future__ import annotations

from collections.abc import Iterable

from nvsim.graph.edits.change import Change, EditError, Place, key_of, unique
from nvsim.graph.edits.moving import move_in
from nvsim.graph.types import NavGraph, edge


def merge_viewpoints(graph: NavGraph, ids: Iterable[str], into: str | None = None, middle: bool = False) -> NavGraph:
    """The viewpoints go except `into` (the first when left out), which takes over their edges to others, at its own
    place or in the middle of them all. Edges that lead to it already stay; the evidence of those that go, goes.

    Raises EditError when there are fewer than two, one is missing, locked, or held by a locked edge.
    """
    names = unique(ids)
    kept = names[0] if into is None and names else into
    if kept is None or len({*names, kept}) < 2:
        raise EditError("Merging takes at least two viewpoints.")
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
