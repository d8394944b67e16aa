"""Add, remove, include, exclude and rename viewpoints. Viewpoints that a user adds have the origin "person"."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

from nvsim.graph.edits.change import Change, EditError, Place, need_number, need_place, unique
from nvsim.graph.types import NavGraph, Viewpoint


def add_viewpoint(graph: NavGraph, viewpoint: Viewpoint) -> NavGraph:
    """Add a viewpoint without edges, at the end. Raises EditError if its id exists already, or if its id or position is
    invalid."""
    if viewpoint.id in graph.viewpoints:
        raise EditError(f"There already is a viewpoint {viewpoint.id}.")
    need_id(viewpoint.id)
    need_place(viewpoint.position)
    change = Change(graph)
    change.put(viewpoint)
    return change.done()


def place_viewpoint(
    graph: NavGraph, position: Place, height: float = 1.5, submap: int = -1, id: str | None = None
) -> NavGraph:
    """Add a viewpoint of a user, with its camera at `position` (x, y, z), meters, `height` meters above the floor.
    Without `id`, the id is derived from the position. Raises EditError if the position or the id is invalid."""
    position = need_place(position)
    height = need_number(height, "The height above the floor")
    return add_viewpoint(
        graph, Viewpoint(new_id(graph, position) if id is None else id, position, height, submap, True, "person")
    )


def snapped(position: Sequence[float], trajectory: Iterable[Sequence[float]]) -> tuple[int, Place]:
    """Return the index and the position (x, y, z), meters, of the frame of the trajectory (N, 3) that is nearest to
    `position`. If `position` is only x and y, the height of frames is ignored. With z, frames on other floors are
    farther away.

    Raises EditError if the trajectory is empty.
    """
    import numpy as np

    walk = np.asarray(trajectory, np.float64).reshape(-1, 3)
    if not len(walk):
        raise EditError("There is no trajectory to snap to.")
    wanted = np.asarray(position, np.float64)
    frame = int(((walk[:, : len(wanted)] - wanted) ** 2).sum(axis=1).argmin())
    x, y, z = walk[frame].tolist()
    return frame, (x, y, z)


def remove_viewpoints(graph: NavGraph, ids: Iterable[str]) -> NavGraph:
    """Remove viewpoints with their edges and all evidence measured from them or towards them.

    Raises EditError if one does not exist, is locked, or has a locked edge.
    """
    change, gone = Change(graph), unique(ids)
    if gone:
        change.drop(*gone)
    return change.done()


def set_included(graph: NavGraph, ids: Iterable[str], included: bool) -> NavGraph:
    """Include viewpoints in navigation, or exclude them and keep them in the file (R2R "included").

    Raises EditError if one does not exist or is locked.
    """
    change = Change(graph)
    for id in unique(ids):
        change.put(replace(change.viewpoint(id), included=included))
    return change.done()


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

    def named(id: str) -> str:
        return new if id == old else id

    edges = [e if old not in e.key else replace(e, a=min(map(named, e.key)), b=max(map(named, e.key)))
             for e in graph.edges.values()]  # fmt: skip
    evidence = [
        replace(e, viewpoint=named(e.viewpoint), joins=named(e.joins)) if old in (e.viewpoint, e.joins) else e
        for e in graph.evidence.values()
    ]
    return replace(
        graph,
        viewpoints={named(id): replace(v, id=new) if id == old else v for id, v in graph.viewpoints.items()},
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
