"""Viewpoints stand elsewhere. What was measured from or towards the old place is marked stale, not lost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from nvsim.graph.edits.change import Change, Place, key_of, need_number, need_place, unique
from nvsim.graph.types import NavGraph


def move_viewpoints(graph: NavGraph, positions: Mapping[str, Place]) -> NavGraph:
    """Each viewpoint goes to its new place, at the same height above its floor. It and its edges become a user's and
    unreviewed, and the evidence measured from or towards its old place stale.

    Raises EditError when one is missing, locked, or held by a locked edge, or a place is not finite.
    """
    change = Change(graph)
    for id, position in positions.items():
        move_in(change, id, need_place(position))
    return change.done()


def move_viewpoint(graph: NavGraph, id: str, position: Place) -> NavGraph:
    """One viewpoint goes to a new place: see `move_viewpoints`."""
    return move_viewpoints(graph, {id: position})


def shift_viewpoints(graph: NavGraph, ids: Iterable[str], by: Place) -> NavGraph:
    """The viewpoints go by the same (dx, dy, dz) metres: see `move_viewpoints`."""
    dx, dy, dz = need_place(by)
    change = Change(graph)
    for id in unique(ids):
        x, y, z = change.viewpoint(id).position
        move_in(change, id, (x + dx, y + dy, z + dz))
    return change.done()


def set_height(graph: NavGraph, ids: Iterable[str], height: float) -> NavGraph:
    """The camera of each viewpoint stands `height` metres above its floor; the floor stays where it is.

    Raises EditError when one is missing, locked, or held by a locked edge, or the height is not positive.
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
    """One viewpoint of a change in the making stands at `position`."""
    found = change.viewpoint(id)
    if found.position == position:
        return
    change.put(replace(found, position=position, origin="person", reviewed=False))
    for other in change.neighbours(id):
        joined = change.edges[key_of(id, other)]
        change.put_edge(replace(joined, origin="person", reviewed=False))
    for key in change.evidence_keys(id):
        evidence = change.evidence[key]
        if not evidence.stale:
            change.put_evidence(replace(evidence, stale=True))
