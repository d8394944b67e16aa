"""Move viewpoints. Evidence measured from or towards an old position is kept and marked as stale."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from nvsim.graph.edits.change import Change, Place, key_of, need_number, need_place, unique
from nvsim.graph.types import NavGraph


def move_viewpoints(graph: NavGraph, positions: Mapping[str, Place]) -> NavGraph:
    """Move each viewpoint to its new position (x, y, z), meters, world, at an unchanged height above the floor. The
    viewpoints and their edges get the origin "person" and are not reviewed. The evidence measured from or towards them
    becomes stale.

    Raises EditError if one does not exist, is locked, or has a locked edge, or if a position is not finite.
    """
    change = Change(graph)
    for id, position in positions.items():
        move_in(change, id, need_place(position))
    return change.done()


def move_viewpoint(graph: NavGraph, id: str, position: Place) -> NavGraph:
    """Move one viewpoint to a new position: see `move_viewpoints`."""
    return move_viewpoints(graph, {id: position})


def shift_viewpoints(graph: NavGraph, ids: Iterable[str], by: Place) -> NavGraph:
    """Move all viewpoints by one offset (dx, dy, dz), meters: see `move_viewpoints`."""
    dx, dy, dz = need_place(by)
    change = Change(graph)
    for id in unique(ids):
        x, y, z = change.viewpoint(id).position
        move_in(change, id, (x + dx, y + dy, z + dz))
    return change.done()


def set_height(graph: NavGraph, ids: Iterable[str], height: float) -> NavGraph:
    """Set the camera of each viewpoint `height` meters above its floor. The floor does not change.

    Raises EditError if one does not exist, is locked, or has a locked edge, or if the height is not positive.
    """
    height = need_number(height, "The height above the floor", positive=True)
    change = Change(graph)
    for id in unique(ids):
        found = change.viewpoint(id)
        x, y, z = found.position
        if found.height == height:
            continue
        move_in(change, id, (x, y, z - found.height + height))
        change.put(replace(change.viewpoint(id), height=height))
    return change.done()


def move_in(change: Change, id: str, position: Place) -> None:
    """Move one viewpoint of an unfinished change to `position`."""
    found = change.viewpoint(id)
    if found.position == position:
        return
    change.put(replace(found, position=position, origin="person", reviewed=False, photographed=None))
    for other in change.neighbours(id):
        joined = change.edges[key_of(id, other)]
        change.put_edge(replace(joined, origin="person", reviewed=False))
    for key in change.evidence_keys(id):
        evidence = change.evidence[key]
        if not evidence.stale:
            change.put_evidence(replace(evidence, stale=True))
