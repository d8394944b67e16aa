"""Move viewpoints: to given positions, to the line between two viewpoints, or to the builder's lattice. Evidence
measured from or toward an old position is kept and marked as stale."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from nvsim.graph.edits.change import Change, EditError, Place, key_of, need_number, need_place, unique
from nvsim.graph.types import NavGraph


def move_viewpoints(graph: NavGraph, positions: Mapping[str, Place]) -> NavGraph:
    """Move each viewpoint to its new position (x, y, z), meters, world, at an unchanged height above the floor. The
    viewpoints and their edges get the origin "person" and are not reviewed. The evidence measured from or toward them
    becomes stale.

    Raises EditError if one does not exist, is locked, or has a locked edge, or if a position is not finite.
    """
    change = Change(graph)
    for id, position in positions.items():
        move_within_change(change, id, need_place(position))
    return change.result()


def move_viewpoint(graph: NavGraph, id: str, position: Place) -> NavGraph:
    """Move one viewpoint to a new position: see `move_viewpoints`."""
    return move_viewpoints(graph, {id: position})


def shift_viewpoints(graph: NavGraph, ids: Iterable[str], by: Place) -> NavGraph:
    """Move all viewpoints by one offset (dx, dy, dz), meters: see `move_viewpoints`."""
    dx, dy, dz = need_place(by)
    change = Change(graph)
    for id in unique(ids):
        x, y, z = change.viewpoint(id).position
        move_within_change(change, id, (x + dx, y + dy, z + dz))
    return change.result()


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
        move_within_change(change, id, (x, y, z - found.height + height))
        change.set_viewpoint(replace(change.viewpoint(id), height=height))
    return change.result()


def move_within_change(change: Change, id: str, position: Place) -> None:
    """Move one viewpoint of an unfinished change to `position`."""
    found = change.viewpoint(id)
    if found.position == position:
        return
    change.set_viewpoint(replace(found, position=position, origin="person", reviewed=False, photographed=None))
    for other in change.neighbors(id):
        joined = change.edges[key_of(id, other)]
        change.set_edge(replace(joined, origin="person", reviewed=False))
    for key in change.evidence_keys(id):
        evidence = change.evidence[key]
        if not evidence.stale:
            change.set_evidence(replace(evidence, stale=True))


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
        move_within_change(change, id, (x, y, z))
    return change.result()


def chain(graph: NavGraph, ids: Iterable[str]) -> tuple[str, ...]:
    """Return the viewpoints in the order in which their edges join them, starting at the end that comes first in the
    file.

    Raises EditError if there are fewer than three, or if they are not one chain without branches.
    """
    change, chosen = Change(graph), dict.fromkeys(unique(ids))
    if len(chosen) < 3:
        raise EditError("A chain needs at least three viewpoints.")
    inside = {id: [o for o in graph.neighbors(change.viewpoint(id).id) if o in chosen] for id in chosen}
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


_AXES = 4  # direction k + 4 is opposite to direction k
_HELD = 1e-6  # meters: a viewpoint this close to its new position is not moved


def align_to_lattice(
    graph: NavGraph, ids: Iterable[str], spacing: float = 2.5, offset: float = 7.5, anchor: str | None = None
) -> NavGraph:
    """Move each viewpoint to a position on the lattice, in whole steps of `spacing` meters from an aligned viewpoint.
    Steps have one of eight directions, 45 degrees apart and rotated by `offset` degrees as in the map builder. Heights
    do not change.

    The alignment starts at `anchor`. Without it, it starts at neighbors of the viewpoints that the map builder placed,
    or else at the first start of a search or the first viewpoint among `ids`. The others follow along edges, those that
    move least first, so that viewpoints on the lattice stay in place.

    Raises EditError if a viewpoint does not exist, or if one that must move is locked or has a locked edge.
    """
    spacing = need_number(spacing, "The spacing of the lattice", positive=True)
    change, chosen = Change(graph), dict.fromkeys(unique(ids))
    for id in (*chosen, *([anchor] if anchor is not None else [])):
        change.viewpoint(id)
    if not chosen:
        return graph
    lattice = _Lattice(graph, spacing, math.radians(need_number(offset, "The turn of the lattice")))
    for seed in _seeds(graph, chosen, anchor):
        lattice.begin(seed)
        chosen.pop(seed, None)
    first = next(iter(lattice.at))
    heap: list[tuple[float, str, _LatticePosition]] = []

    def push_neighbors(parent: str) -> None:
        for other in graph.neighbors(parent):
            if other in chosen:
                meters, spot = lattice.step(parent, other)
                heapq.heappush(heap, (meters, other, spot))

    for id in list(lattice.at):
        push_neighbors(id)
    while chosen:
        if not heap:  # no edge leads to the remaining viewpoints
            id = next(iter(chosen))
            spot = lattice.nearest(first, id)
        else:
            _, id, spot = heapq.heappop(heap)
            if id not in chosen:
                continue
        del chosen[id]
        lattice.at[id] = spot
        position = graph.viewpoints[id].position
        x, y = lattice.place(spot)
        if math.dist(position[:2], (x, y)) > _HELD:
            move_within_change(change, id, (x, y, position[2]))
        push_neighbors(id)
    return change.result()


@dataclass(frozen=True, order=True)
class _LatticePosition:
    """A lattice position as whole steps along four axes from an anchor, so that all paths to it give equal numbers."""

    anchor: str
    counts: tuple[int, ...]


class _Lattice:
    def __init__(self, graph: NavGraph, spacing: float, offset: float) -> None:
        self.graph = graph
        self.spacing = spacing
        turns = [offset + k * math.pi / _AXES for k in range(_AXES)]
        # Heading 0 is +y and positive turns right.
        self.steps = [(spacing * math.sin(h), spacing * math.cos(h)) for h in turns]
        self.at: dict[str, _LatticePosition] = {}

    def begin(self, id: str) -> None:
        self.at[id] = _LatticePosition(id, (0,) * _AXES)

    def place(self, spot: _LatticePosition) -> tuple[float, float]:
        x, y, _ = self.graph.viewpoints[spot.anchor].position
        for n, (dx, dy) in zip(spot.counts, self.steps, strict=True):
            x, y = x + n * dx, y + n * dy
        return x, y

    def step(self, parent: str, id: str) -> tuple[float, _LatticePosition]:
        """Return the meters that `id` moves (rounded, for a stable order) and its new position. It is whole steps from
        its parent, at least one, in the best direction."""
        found = []
        for k, along in enumerate(self._steps_along_axes(parent, id)):
            n = round(along) or (1 if along >= 0 else -1)
            spot = self._step_from(self.at[parent], {k: n})
            found.append((round(math.dist(self.place(spot), self.graph.viewpoints[id].position[:2]), 6), spot))
        return min(found)

    def nearest(self, origin: str, id: str) -> _LatticePosition:
        """Return the position with the smallest move of `id`, along two perpendicular axes from `origin`."""
        along = self._steps_along_axes(origin, id)
        return self._step_from(self.at[origin], {0: round(along[0]), 2: round(along[2])})

    def _steps_along_axes(self, origin: str, id: str) -> list[float]:
        """Steps from the position of `origin` to `id` along every axis."""
        x, y = self.place(self.at[origin])
        tx, ty, _ = self.graph.viewpoints[id].position
        return [((tx - x) * dx + (ty - y) * dy) / self.spacing**2 for dx, dy in self.steps]

    @staticmethod
    def _step_from(spot: _LatticePosition, more: dict[int, int]) -> _LatticePosition:
        return _LatticePosition(spot.anchor, tuple(n + more.get(k, 0) for k, n in enumerate(spot.counts)))


def _seeds(graph: NavGraph, chosen: dict[str, None], anchor: str | None) -> list[str]:
    if anchor is not None:
        return [anchor]
    joined = unique(other for id in chosen for other in graph.neighbors(id) if other not in chosen)
    builders = [id for id in joined if graph.viewpoints[id].origin in ("start", "step")]
    if builders:
        return builders
    starts = [id for id in chosen if graph.viewpoints[id].origin == "start"]
    return starts[:1] or [next(id for id in graph.viewpoints if id in chosen)]
