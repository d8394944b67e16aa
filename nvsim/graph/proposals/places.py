"""Viewpoints to propose: floor that can be reached and that no viewpoint sees from near."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits import new_id
from nvsim.graph.findings.viewpoints import short
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.occupancy.paths import clearance, reachable, segments_are_free, visible
from nvsim.occupancy.types import OccupancyMap

_APART = 0.4  # metres between the places that are tried
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
    held = [v for v in graph.viewpoints.values() if v.included]
    if not held:
        return ()
    xy = np.array([v.position[:2] for v in held], np.float64)
    missing = reachable(occupancy, xy, radius) & ~visible(occupancy, xy, sees)
    if missing.sum() * occupancy.resolution**2 < least:
        return ()
    room = clearance(occupancy)
    stand = room >= radius
    tried = _Tried(occupancy, missing, sees)
    waiting = []
    for place in _candidates(occupancy, missing, room, radius, sees):
        seen = tried.seen(place)
        if len(seen):
            # Of places that see as much, the one with more room around it.
            comfort = min(1.0, float(room[tuple(occupancy.index(np.array(place)).tolist())]) / (_ROOM * radius))
            waiting.append((-len(seen), -comfort, place[0], place[1], seen))
    waiting.sort(key=lambda item: item[:4])
    heapq.heapify(order := [(*item[:4], i) for i, item in enumerate(waiting)])
    area, whole = occupancy.resolution**2, math.pi * sees * sees
    found: list[PlaceProposal] = []
    while order and len(found) < most:
        count, comfort, x, y, index = heapq.heappop(order)
        left = waiting[index][4]
        left = left[missing.flat[left]]
        if len(left) < -count:
            # Others have seen some of it since: gains only shrink, so it waits for its turn again.
            if len(left) * area >= least:
                heapq.heappush(order, (-len(left), comfort, x, y, index))
            continue
        if len(left) * area < least:
            break
        missing.flat[left] = False
        proposal = _proposal(graph, (x, y), len(left) * area, held, stand, occupancy, reach, whole)
        found.append(proposal)
        held.append(Viewpoint(proposal.new_id, proposal.position, proposal.height))
    return tuple(found)


class _Tried:
    """Sees from a place, looking at the part of the map around it alone."""

    def __init__(self, occupancy: OccupancyMap, missing: NDArray[np.bool_], sees: float) -> None:
        self._map, self._missing, self._sees = occupancy, missing, sees

    def seen(self, place: tuple[float, float]) -> NDArray[np.int64]:
        """Flat indices of the missing cells that are seen from `place`."""
        rows, columns = self._map.cells.shape
        row, column = self._map.index(np.array(place)).tolist()
        around = math.ceil(self._sees / self._map.resolution) + 1
        top, left = max(0, row - around), max(0, column - around)
        part = (slice(top, min(rows, row + around + 1)), slice(left, min(columns, column + around + 1)))
        if not self._missing[part].any():
            return np.zeros(0, np.int64)
        scale, (x, y) = self._map.resolution, self._map.origin
        window = OccupancyMap(np.ascontiguousarray(self._map.cells[part]), scale, (x + left * scale, y + top * scale))
        r, c = np.nonzero(visible(window, np.array(place), self._sees) & self._missing[part])
        return np.asarray((r + top) * columns + c + left, np.int64)


def _candidates(
    occupancy: OccupancyMap, missing: NDArray[np.bool_], room: NDArray[np.float64], radius: float, sees: float
) -> list[tuple[float, float]]:
    """Of every square of a coarse grid that has missing floor, the cell with the most room around it."""
    step = max(1, round(_APART / occupancy.resolution))
    rows, columns = np.nonzero(missing & (room >= radius))
    square = (rows // step) * (missing.shape[1] // step + 1) + columns // step
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
    held: list[Viewpoint],
    stand: NDArray[np.bool_],
    occupancy: OccupancyMap,
    reach: float,
    whole: float,
) -> PlaceProposal:
    xy = np.array([v.position[:2] for v in held], np.float64)
    distance = np.hypot(*(xy - place).T)
    near = np.argsort(distance, kind="stable")
    level = held[int(near[0])]
    near = near[distance[near] <= reach]
    free = segments_are_free(stand, occupancy, np.broadcast_to(place, (len(near), 2)), xy[near])
    joins = tuple(held[int(i)].id for i in near[free][:_MOST_JOINS])
    score = min(1.0, gain / whole) * (1.0 if joins else 0.5)
    to = (
        f"it can be joined to {' and '.join(map(short, joins))}" if joins else "no viewpoint is near in a straight line"
    )
    words = f"{gain:.1f} m² of floor that no viewpoint sees from near; {to}."
    position = (*place, level.position[2])
    return PlaceProposal(new_id(graph, position), position, level.height, gain, joins, score, words)
