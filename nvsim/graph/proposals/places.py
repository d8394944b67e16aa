"""Viewpoints to propose: floor that can be reached and that no viewpoint sees from near."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits import new_id
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.occupancy.types import FREE, OccupancyMap

_GRAIN = 0.25  # metres: floor is looked at in squares no larger, single cells where those are larger
_APART = 0.8  # metres between the places that are tried
_ROOM = 2.0  # times the radius: with that much around it a place is as good as any
_MOST_JOINS = 3


@dataclass(frozen=True)
class PlaceProposal:
    """new_id    the id that it would get
    position  (x, y, z) metres, world, of the camera; z and height are those of the nearest viewpoint
    height    metres above the floor
    gain      square metres of floor that are seen from there and, from near, nowhere else
    joins     ids of viewpoints, or of places before it, that a disc can go straight to, the nearest first
    score     0 to 1: the gain as a share of all that could be seen; half of it where there is nothing to join
    words     one sentence
    """

    new_id: str
    position: tuple[float, float, float]
    height: float
    gain: float
    joins: tuple[str, ...]
    score: float
    words: str


def propose_viewpoints(
    graph: NavGraph,
    occupancy: OccupancyMap,
    *,
    sees: float = 3.0,
    radius: float = 0.25,
    reach: float = 3.5,
    least: float = 0.5,
    most: int = 20,
) -> tuple[PlaceProposal, ...]:
    """At most `most` places in the order in which they should be taken: each adds the most floor (at least `least`
    square metres) to what is seen within `sees` metres by an included viewpoint or a place before it. That greedy
    choice covers at least 1 - 1/e of what the best choice of as many would (Nemhauser et al. 1978).

    Asked for is floor that a disc of `radius` metres reaches from the viewpoints. The map knows one floor: give only a
    graph of that floor.
    """
    from nvsim.occupancy.paths import clearance, reachable

    held = [v for v in graph.viewpoints.values() if v.included]
    if not held:
        return ()
    floor = _Floor(occupancy, reachable(occupancy, np.array([v.position[:2] for v in held]), radius), sees)
    for v in held:
        floor.take(floor.seen(v.position[:2]))
    room = clearance(occupancy)
    waiting: list[NDArray[np.int64]] = []
    order = []
    for place in _candidates(occupancy, floor.missing, room, radius):
        seen = floor.seen(place)
        # Of places that see as much, the one with more room around it.
        comfort = min(1.0, float(room[tuple(occupancy.index(np.array(place)).tolist())]) / (_ROOM * radius))
        order.append((-len(seen), -comfort, *place, len(waiting)))
        waiting.append(seen)
    heapq.heapify(order)
    found: list[PlaceProposal] = []
    while order and len(found) < most:
        count, comfort, x, y, index = heapq.heappop(order)
        left = floor.still_missing(waiting[index])
        if len(left) * floor.each < least:
            continue
        if len(left) < -count:
            # Others have seen some of it since: gains only shrink, so it waits for its turn again.
            heapq.heappush(order, (-len(left), comfort, x, y, index))
            continue
        floor.take(left)
        gain = len(left) * floor.each
        share = min(1.0, gain / (math.pi * sees * sees))
        proposal = _proposal(graph, (x, y), gain, share, held, room >= radius, occupancy, reach)
        found.append(proposal)
        held.append(Viewpoint(proposal.new_id, proposal.position, proposal.height))
    return tuple(found)


class _Floor:
    """Floor in samples at most _GRAIN apart, at the centres of cells, and which of them nobody sees yet.

    each   square metres that a sample stands for
    """

    def __init__(self, occupancy: OccupancyMap, wanted: NDArray[np.bool_], sees: float) -> None:
        from scipy.spatial import cKDTree

        step = max(1, int(_GRAIN / occupancy.resolution + 1e-9))
        self._map, self._sees = occupancy, sees
        self._free = occupancy.cells == FREE
        self._cells = np.argwhere(wanted[::step, ::step]) * step
        self._xy = (self._cells[:, ::-1] + 0.5) * occupancy.resolution + np.array(occupancy.origin)
        self._tree = cKDTree(self._xy)
        self._unseen = np.ones(len(self._cells), np.bool_)
        self.each = (step * occupancy.resolution) ** 2

    @property
    def missing(self) -> NDArray[np.int64]:
        """(M, 2) row and column of the samples that nobody sees."""
        return np.asarray(self._cells[self._unseen])

    def seen(self, place: tuple[float, float]) -> NDArray[np.int64]:
        """Those samples that are missing and seen from `place` (x, y)."""
        from nvsim.occupancy.paths import segments_are_free

        near = self.still_missing(np.array(self._tree.query_ball_point(place, self._sees + 1e-9), np.int64))
        starts = np.broadcast_to(np.array(place), (len(near), 2))
        return np.asarray(near[segments_are_free(self._free, self._map, starts, self._xy[near])])

    def still_missing(self, samples: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.asarray(samples[self._unseen[samples]])

    def take(self, samples: NDArray[np.int64]) -> None:
        """They are seen now."""
        self._unseen[samples] = False


def _candidates(
    occupancy: OccupancyMap, missing: NDArray[np.int64], room: NDArray[np.float64], radius: float
) -> list[tuple[float, float]]:
    """Of every square of a coarse grid that has missing floor (M, 2), the cell with the most room around it."""
    step = max(1, round(_APART / occupancy.resolution))
    rows, columns = missing[room[missing[:, 0], missing[:, 1]] >= radius].T
    square = (rows // step) * (occupancy.cells.shape[1] // step + 1) + columns // step
    order = np.lexsort((-room[rows, columns], square))
    _, first = np.unique(square[order], return_index=True)
    chosen = order[first]
    x = occupancy.origin[0] + (columns[chosen] + 0.5) * occupancy.resolution
    y = occupancy.origin[1] + (rows[chosen] + 0.5) * occupancy.resolution
    return list(zip(x.tolist(), y.tolist(), strict=True))


def _proposal(
    graph: NavGraph,
    place: tuple[float, float],
    gain: float,
    share: float,
    held: list[Viewpoint],
    stand: NDArray[np.bool_],
    occupancy: OccupancyMap,
    reach: float,
) -> PlaceProposal:
    from nvsim.occupancy.paths import segments_are_free

    xy = np.array([v.position[:2] for v in held], np.float64)
    distance = np.hypot(*(xy - place).T)
    near = np.argsort(distance, kind="stable")
    level = held[int(near[0])]
    near = near[distance[near] <= reach]
    free = segments_are_free(stand, occupancy, np.broadcast_to(place, (len(near), 2)), xy[near])
    joins = tuple(held[int(i)].id for i in near[free][:_MOST_JOINS])
    score = share * (1.0 if joins else 0.5)
    to = "no viewpoint is near in a straight line"
    if joins:
        to = f"it can be joined to {' and '.join(map(graph.short, joins))}"
    words = f"{gain:.1f} m² of floor that no viewpoint sees from near; {to}."
    position = (*place, level.position[2])
    return PlaceProposal(new_id(graph, position), position, level.height, gain, joins, score, words)
