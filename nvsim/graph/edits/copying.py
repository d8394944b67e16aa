"""Copy a part of the graph to another floor."""

from __future__ import annotations

from collections.abc import Iterable

from nvsim.graph.edits.change import Change, EditError, need_place, unique
from nvsim.graph.edits.viewpoints import new_id
from nvsim.graph.types import NavGraph, Viewpoint, edge


def copy_by(graph: NavGraph, ids: Iterable[str], dz: float, dx: float = 0.0, dy: float = 0.0) -> NavGraph:
    """Copy viewpoints and the edges between them `dz` meters up (and dx, dy aside). The copies have the origin
    "person". They have no evidence and no submap, because nothing was measured there.

    Raises EditError if a viewpoint does not exist or the copies would be at the positions of the originals.
    """
    dx, dy, dz = need_place((dx, dy, dz))
    if dx == dy == dz == 0:
        raise EditError("The copies would be at the positions of the originals.")
    change, copies = Change(graph), {}
    for id in unique(ids):
        found = change.viewpoint(id)
        x, y, z = found.position
        place = (x + dx, y + dy, z + dz)
        copies[id] = new_id(graph, place)
        while copies[id] in change.viewpoints:  # two originals at one position
            copies[id] = new_id(graph, (*place[:2], place[2] + 0.001 * len(copies)))
        change.put(Viewpoint(copies[id], place, found.height, -1, found.included, "person"))
    for id, copy in copies.items():
        for other in graph.neighbours(id):
            if other in copies and id < other:
                change.put_edge(edge(copy, copies[other], "person"))
    return change.done()
