"""Viewpoints are laid on the builder's lattice: places that steps of one length in eight directions lead to."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable
from dataclasses import dataclass

from nvsim.graph.edits.change import Change, need_number, unique
from nvsim.graph.edits.moving import move_in
from nvsim.graph.types import NavGraph

_AXES = 4  # direction k + 4 is the way back of direction k
_HELD = 1e-6  # metres: a viewpoint this near to its place stays as it is


def align_to_lattice(
    graph: NavGraph, ids: Iterable[str], spacing: float = 2.5, offset: float = 7.5, anchor: str | None = None
) -> NavGraph:
    """Every one of the viewpoints goes to where whole steps of `spacing` metres lead, in one of eight directions (45
    degrees apart, turned by `offset` degrees as the builder turns them), from an aligned viewpoint; heights stay.

    Aligned from the beginning is `anchor`; without it those of the builder's viewpoints that the chosen ones are joined
    to; without any the first of the chosen in the file. The others follow along edges, those that move least first, so
    that what the builder placed by steps stays where it is. Raises EditError when a viewpoint is missing, or one that
    has to move is locked or held by a locked edge.
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
        if not heap:  # no edge leads to what is left
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
    """A place as whole steps along four axes from an anchor, so that every way to it gives the same numbers."""

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
        """Metres (rounded, for an order without noise) that `id` moves to stand whole steps from its parent, at least
        one, in the best direction; and where that is."""
        found = []
        for k, along in enumerate(self._along(parent, id)):
            n = round(along) or (1 if along >= 0 else -1)
            spot = self._further(self.at[parent], {k: n})
            found.append((round(math.dist(self.place(spot), self.graph.viewpoints[id].position[:2]), 6), spot))
        return min(found)

    def nearest(self, origin: str, id: str) -> _Spot:
        """Where `id` moves least when it may go along two axes at right angles."""
        along = self._along(origin, id)
        return self._further(self.at[origin], {0: round(along[0]), 2: round(along[2])})

    def _along(self, origin: str, id: str) -> list[float]:
        """Steps from the place of `origin` to `id` along every axis."""
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
