"""Split an edge with a viewpoint."""

from __future__ import annotations

from nvsim.graph.edits.change import Change, EditError, Place, need_number, need_place
from nvsim.graph.edits.viewpoints import need_id, new_id
from nvsim.graph.types import NavGraph, Viewpoint, edge


def split_edge(
    graph: NavGraph, a: str, b: str, share: float = 0.5, position: Place | None = None, id: str | None = None
) -> NavGraph:
    """Replace an edge by a viewpoint of a user that is joined to both its ends. The viewpoint is on the line at `share`
    (0 to 1) from a to b, or at `position` if it is given. Its height above the floor is interpolated between the ends.

    Raises EditError if the edge does not exist or is locked, the share is not between 0 and 1, or the id exists already
    or is invalid.
    """
    share = need_number(share, "The share of the edge")
    if not 0 < share < 1:
        raise EditError(f"The share of the edge must be between 0 and 1, but it is {share:g}.")
    change = Change(graph)
    found = change.edge(a, b)
    if found.locked:
        raise EditError(f"The edge from {a} to {b} is locked; unlock it first.")
    start, end = change.viewpoint(a), change.viewpoint(b)
    x, y, z = (p + share * (q - p) for p, q in zip(start.position, end.position, strict=True))
    place = (x, y, z) if position is None else need_place(position)
    name = new_id(graph, place) if id is None else id
    if name in graph.viewpoints:
        raise EditError(f"There already is a viewpoint {name}.")
    need_id(name)
    submap = start.submap if share < 0.5 else end.submap
    height = start.height + share * (end.height - start.height)
    change.put(Viewpoint(name, place, height, submap, True, "person"))
    change.drop_edge(a, b)
    change.put_edge(edge(a, name, "person"))
    change.put_edge(edge(name, b, "person"))
    return change.done()
