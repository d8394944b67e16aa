"""Straighten a chain of viewpoints."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from nvsim.graph.edits.change import Change, EditError, unique
from nvsim.graph.edits.moving import move_in
from nvsim.graph.types import NavGraph


def straighten(graph: NavGraph, ids: Iterable[str], even: bool = False) -> NavGraph:
    """Move the inner viewpoints of a chain to the nearest points on the line between its ends, in their order. With
    `even`, they are spaced evenly. The ends do not move. The edges between the viewpoints define the chain.

    Raises EditError if the viewpoints are not a chain, its ends are at one position, or it turns back and `even` is not
    set. Also raises it if a viewpoint does not exist or is locked.
    """
    order = chain(graph, ids)
    places = np.array([graph.viewpoints[id].position for id in order])
    along = places[-1] - places[0]
    length = float(along @ along)
    if length < 1e-12:
        raise EditError("The two ends of the chain are at one position; there is no line between them.")
    shares = np.linspace(0.0, 1.0, len(order)) if even else np.clip((places - places[0]) @ along / length, 0.0, 1.0)
    if not even and (np.diff(shares) <= 0).any():
        raise EditError("The chain turns back on itself; space it evenly, or select a part of it.")
    change = Change(graph)
    for id, share in zip(order[1:-1], shares[1:-1].tolist(), strict=True):
        x, y, z = (places[0] + share * along).tolist()
        move_in(change, id, (x, y, z))
    return change.done()


def chain(graph: NavGraph, ids: Iterable[str]) -> tuple[str, ...]:
    """Return the viewpoints in the order in which their edges join them, starting at the end that comes first in the
    file.

    Raises EditError if there are fewer than three, or if they are not one chain without branches.
    """
    change, chosen = Change(graph), dict.fromkeys(unique(ids))
    if len(chosen) < 3:
        raise EditError("A chain needs at least three viewpoints.")
    inside = {id: [o for o in graph.neighbours(change.viewpoint(id).id) if o in chosen] for id in chosen}
    ends = [id for id in graph.viewpoints if id in inside and len(inside[id]) == 1]
    if len(ends) != 2 or any(len(others) > 2 for others in inside.values()):
        raise EditError(
            "The viewpoints are not one chain; select viewpoints that are joined one after the other, without branches."
        )
    order, before = [ends[0]], ""
    while True:
        following = [id for id in inside[order[-1]] if id != before]
        if not following:
            break
        before = order[-1]
        order.append(following[0])
    if len(order) != len(chosen):
        raise EditError(
            "The viewpoints are not one chain; select viewpoints that are joined one after the other, without branches."
        )
    return tuple(order)
