"""Viewpoints come, go, leave navigation and come back to it. What a user adds carries the origin "person"."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

from nvsim.graph.edits.change import Change, EditError, Place, need_number, need_place, unique
from nvsim.graph.types import NavGraph, Viewpoint


def add_viewpoint(graph: NavGraph, viewpoint: Viewpoint) -> NavGraph:
    """A viewpoint without edges, at the end. Raises EditError when its id is taken or unusable."""
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
    """A user's viewpoint whose camera stands at `position`, `height` metres above the floor; its id is made from the
    place when none is given. Raises EditError when the place or the id is unusable."""
    position = need_place(position)
    height = need_number(height, "The height above the floor")
    return add_viewpoint(
        graph, Viewpoint(new_id(graph, position) if id is None else id, position, height, submap, True, "person")
    )


def snapped(position: Sequence[float], trajectory: Iterable[Sequence[float]]) -> tuple[int, Place]:
    """The frame of the trajectory (N, 3) that is nearest to `position` as seen from above, and its place, metres. Where
    only x and y are given, the height of the frame is not looked at; with z, floors are kept apart.

    Raises EditError when there is no walk.
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
    """The viewpoints go, and with them their edges and all evidence measured from them or towards them.

    Raises EditError when one of them is not there or is locked.
    """
    change, gone = Change(graph), unique(ids)
    if gone:
        change.drop(*gone)
    return change.done()


def set_included(graph: NavGraph, ids: Iterable[str], included: bool) -> NavGraph:
    """The viewpoints stay in the file and leave navigation, or come back to it, as the format's "included" means it.

    Raises EditError when one of them is not there or is locked.
    """
    change = Change(graph)
    for id in unique(ids):
        change.put(replace(change.viewpoint(id), included=included))
    return change.done()


def rename_viewpoint(graph: NavGraph, old: str, new: str) -> NavGraph:
    """The viewpoint gets another id and keeps its place in the file, its edges and its evidence.

    Raises EditError when it is missing or locked, or the new id is taken or unusable.
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
    """32 lower-case hex digits from the scan and the place to the millimetre, as Matterport3D's ids look; the same for
    the same graph and place, and not taken yet."""
    place = " ".join(str(round(value * 1000)) for value in position)
    for number in range(len(graph.viewpoints) + 1):
        id = hashlib.blake2b(f"{graph.scan} {place} {number}".encode(), digest_size=16).hexdigest()
        if id not in graph.viewpoints:
            break
    return id


def need_id(id: str) -> None:
    """Raises EditError when `id` cannot be the id of a viewpoint."""
    if not id or "/" in id:
        raise EditError(f"{id!r} cannot be the id of a viewpoint.")
