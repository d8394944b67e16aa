"""A part of the graph is copied to another floor."""

from __future__ import annotations

from collections.abc import Iterable

from nvsim.graph.edits.change import Change, EditError, need_place, unique
from nvsim.graph.edits.viewpoints import new_id
from nvsim.graph.types import NavGraph, Viewpoint, edge


def copy_by(graph: NavGraph, ids: Iterable[str], dz: float, dx: float = 0.0, dy: float = 0.0) -> NavGraph:
    """The viewpoints are copied `dz` metres higher (and dx, dy aside), as a user's, with the edges among them, and
    without evidence or submap, since nothing was seen from there.

    Raises EditError when one is missing or the copies would stand where the originals are.
    """
    dx, dy, dz = need_place((dx, dy, dz))
    if dx == dy == dz == 0:
        raise EditError("The copies would stand where the originals are.")
    change, copies = Change(graph), {}
    for id in unique(ids):
        found = change.viewpoint(id)
        x, y, z = found.position
        place = (x + dx, y + dy, z + dz)
        copies[id] = new_id(graph, place)
        while copies[id] in change.viewpoints:  # two originals at one place
            copies[id] = new_id(graph, (*place[:2], place[2] + 0.001 * len(copies)))
        change.put(Viewpoint(copies[id], place, found.height, -1, found.included, "person"))
    for id, copy in copies.items():
        for other in graph.neighbours(id):
            if other in copies and id < other:
                change.put_edge(edge(copy, copies[other], "person"))
    return change.done()
