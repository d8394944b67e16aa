"""Add, copy, merge, remove, include, exclude and rename viewpoints, and split edges with them. Viewpoints that a user
adds have the origin "person"."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from nvsim.graph.edits.change import Change, EditError, Place, key_of, need_number, need_place, unique
from nvsim.graph.edits.moving import move_within_change
from nvsim.graph.types import Edge, EdgeKey, NavGraph, Viewpoint, edge


def add_viewpoint(graph: NavGraph, viewpoint: Viewpoint) -> NavGraph:
    """Add a viewpoint without edges, at the end. Raises EditError if its id exists already, or if its id or position is
    invalid."""
    if viewpoint.id in graph.viewpoints:
        raise EditError(f"There already is a viewpoint {viewpoint.id}.")
    need_id(viewpoint.id)
    need_place(viewpoint.position)
    change = Change(graph)
    change.set_viewpoint(viewpoint)
    return change.result()


def place_viewpoint(
    graph: NavGraph, position: Place, height: float = 1.5, submap: int = -1, id: str | None = None
) -> NavGraph:
    """Add a viewpoint of a user, with its camera at `position` (x, y, z), meters, `height` meters above the floor.
    Without `id`, the id is derived from the position. Raises EditError if the position or the id is invalid."""
    position = need_place(position)
    height = need_number(height, "The height above the floor", positive=True)
    return add_viewpoint(
        graph, Viewpoint(new_id(graph, position) if id is None else id, position, height, submap, True, "person")
    )


def nearest_trajectory_position(position: Sequence[float], trajectory: Iterable[Sequence[float]]) -> tuple[int, Place]:
    """Return the index and the position (x, y, z), meters, of the frame of the trajectory (N, 3) that is nearest to
    `position`. If `position` is only x and y, the height of frames is ignored. With z, frames on other floors are
    farther away.

    Raises EditError if the trajectory is empty.
    """
    walk = np.asarray(trajectory, np.float64).reshape(-1, 3)
    if not len(walk):
        raise EditError("There is no trajectory to snap to.")
    wanted = np.asarray(position, np.float64)
    frame = int(((walk[:, : len(wanted)] - wanted) ** 2).sum(axis=1).argmin())
    x, y, z = walk[frame].tolist()
    return frame, (x, y, z)


def remove_viewpoints(graph: NavGraph, ids: Iterable[str]) -> NavGraph:
    """Remove viewpoints with their edges and all evidence measured from them or toward them.

    Raises EditError if one does not exist, is locked, or has a locked edge.
    """
    change, gone = Change(graph), unique(ids)
    if gone:
        change.remove_viewpoints(*gone)
    return change.result()


def set_included(graph: NavGraph, ids: Iterable[str], included: bool) -> NavGraph:
    """Include viewpoints in navigation, or exclude them and keep them in the file (R2R "included").

    Raises EditError if one does not exist or is locked.
    """
    change = Change(graph)
    for id in unique(ids):
        change.set_viewpoint(replace(change.viewpoint(id), included=included))
    return change.result()


def rename_viewpoint(graph: NavGraph, old: str, new: str) -> NavGraph:
    """Give a viewpoint another id. It keeps its order in the file, its edges and its evidence.

    Raises EditError if it does not exist or is locked, or if the new id exists already or is invalid.
    """
    change = Change(graph)
    found = change.viewpoint(old)
    if old == new:
        return graph
    if new in graph.viewpoints:
        raise EditError(f"There already is a viewpoint {new}.")
    need_id(new)
    if found.locked:
        raise EditError(f"Viewpoint {old} is locked; unlock it first.")

    def renamed_id(id: str) -> str:
        return new if id == old else id

    edges = [e if old not in e.key else replace(e, a=min(map(renamed_id, e.key)), b=max(map(renamed_id, e.key)))
             for e in graph.edges.values()]  # fmt: skip
    evidence = [
        replace(e, viewpoint=renamed_id(e.viewpoint), joins=renamed_id(e.joins)) if old in (e.viewpoint, e.joins) else e
        for e in graph.evidence.values()
    ]
    return replace(
        graph,
        viewpoints={renamed_id(id): replace(v, id=new) if id == old else v for id, v in graph.viewpoints.items()},
        edges={e.key: e for e in edges},
        evidence={e.key: e for e in evidence},
    )


def new_id(graph: NavGraph, position: Place) -> str:
    """Return an unused id: 32 lower-case hex digits from the scan and the position in millimeters, as in Matterport3D.
    An equal graph and position give an equal id."""
    place = " ".join(str(round(value * 1000)) for value in position)
    for number in range(len(graph.viewpoints) + 1):
        id = hashlib.blake2b(f"{graph.scan} {place} {number}".encode(), digest_size=16).hexdigest()
        if id not in graph.viewpoints:
            break
    return id


def need_id(id: str) -> None:
    """Check a viewpoint id. Raises EditError if it is empty or contains a slash."""
    if not id or "/" in id:
        raise EditError(f"{id!r} cannot be the id of a viewpoint.")


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
    change.set_viewpoint(Viewpoint(name, place, height, submap, True, "person"))
    change.remove_edge(a, b)
    change.set_edge(edge(a, name, "person"))
    change.set_edge(edge(name, b, "person"))
    return change.result()


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
    others = unique(other for id in gone for other in change.neighbors(id) if other != kept and other not in gone)
    change.remove_viewpoints(*gone)
    if middle:
        move_within_change(change, kept, _mean(places))
    for other in others:
        if key_of(kept, other) not in change.edges:
            change.set_edge(edge(kept, other, "person"))
    return change.result()


def _mean(places: list[Place]) -> Place:
    x, y, z = (sum(values) / len(places) for values in zip(*places, strict=True))
    return x, y, z


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
        change.set_viewpoint(Viewpoint(copies[id], place, found.height, -1, found.included, "person"))
    for id, copy in copies.items():
        for other in graph.neighbors(id):
            if other in copies and id < other:
                change.set_edge(edge(copy, copies[other], "person"))
    return change.result()


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
        change.remove_edge(a, b)
    gone = unique(no_viewpoints)
    if gone:
        change.remove_viewpoints(*gone)
    for viewpoint in viewpoints:
        need_id(viewpoint.id)
        need_place(viewpoint.position)
        need_number(viewpoint.height, "The height above the floor", positive=True)
        change.set_viewpoint(viewpoint)
    for given in edges:
        a, b = key_of(given.a, given.b)
        change.set_edge(Edge(a, b, given.origin, given.reviewed, given.locked))
    return change.result()
