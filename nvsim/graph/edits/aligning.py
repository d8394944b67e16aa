"""Align viewpoints to the builder's lattice: positions that steps of one length in eight directions lead to."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from dataclasses import dataclass

from nvsim.graph.edits.change import Change, need_number, unique
from nvsim.graph.edits.moving import move_in
from nvsim.graph.types import NavGraph

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
    heap: list[tuple[float, str, _Spot]] = []

    def offer(parent: str) -> None:
        for other in graph.neighbours(parent):
            if other in chosen:
                metres, spot = lattice.step(parent, other)
                heapq.heappush(heap, (metres, other, spot))

    for id in list(lattice.at):
        offer(id)
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
            move_in(change, id, (x, y, position[2]))
        offer(id)
    return change.done()


@dataclass(frozen=True, order=True)
class _Spot:
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
        self.at: dict[str, _Spot] = {}

    def begin(self, id: str) -> None:
        self.at[id] = _Spot(id, (0,) * _AXES)

    def place(self, spot: _Spot) -> tuple[float, float]:
        x, y, _ = self.graph.viewpoints[spot.anchor].position
        for n, (dx, dy) in zip(spot.counts, self.steps, strict=True):
            x, y = x + n * dx, y + n * dy
        return x, y

    def step(self, parent: str, id: str) -> tuple[float, _Spot]:
        """Return the meters that `id` moves (rounded, for a stable order) and its new position. It is whole steps from
        its parent, at least one, in the best direction."""
        found = []
        for k, along in enumerate(self._along(parent, id)):
            n = round(along) or (1 if along >= 0 else -1)
            spot = self._further(self.at[parent], {k: n})
            found.append((round(math.dist(self.place(spot), self.graph.viewpoints[id].position[:2]), 6), spot))
        return min(found)

    def nearest(self, origin: str, id: str) -> _Spot:
        """Return the position with the smallest move of `id`, along two perpendicular axes from `origin`."""
        along = self._along(origin, id)
        return self._further(self.at[origin], {0: round(along[0]), 2: round(along[2])})

    def _along(self, origin: str, id: str) -> list[float]:
        """Steps from the position of `origin` to `id` along every axis."""
        x, y = self.place(self.at[origin])
        tx, ty, _ = self.graph.viewpoints[id].position
        return [((tx - x) * dx + (ty - y) * dy) / self.spacing**2 for dx, dy in self.steps]

    @staticmethod
    def _further(spot: _Spot, more: dict[int, int]) -> _Spot:
        return _Spot(spot.anchor, tuple(n + more.get(k, 0) for k, n in enumerate(spot.counts)))


def _seeds(graph: NavGraph, chosen: dict[str, None], anchor: str | None) -> list[str]:
    if anchor is not None:
        return [anchor]
    joined = unique(other for id in chosen for other in graph.neighbours(id) if other not in chosen)
    builders = [id for id in joined if graph.viewpoints[id].origin in ("start", "step")]
    if builders:
        return builders
    starts = [id for id in chosen if graph.viewpoints[id].origin == "start"]
    return starts[:1] or [next(id for id in graph.viewpoints if id in chosen)]
