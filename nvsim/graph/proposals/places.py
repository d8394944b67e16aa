"""Propose viewpoints: reachable floor that no viewpoint sees from nearby."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits import new_id
from nvsim.graph.types import NavGraph, Viewpoint
from nvsim.occupancy.types import FREE, OccupancyMap

_GRAIN = 0.25  # meters: maximum side of the squares in which floor is sampled, or single cells if these are larger
_APART = 0.8  # meters between candidate positions
_ROOM = 2.0  # times the radius: more room than this around a position is no advantage
_MOST_JOINS = 3
_LEAST = 0.5  # square meters that a proposal must add


@dataclass(frozen=True)
class PlaceProposal:
    """A proposed viewpoint.

    new_id    the id that it would get
    position  (x, y, z) of the camera, meters, world; z and height are those of the nearest viewpoint
    height    meters above the floor
    gain      square meters of floor that are only seen from there
    joins     ids of viewpoints, or of earlier proposals, that a disc can reach in a straight line, the nearest first
    score     0 to 1: the gain as a share of the area within the viewing distance; half of it if there is nothing to
              join
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
    most: int = 20,
) -> tuple[PlaceProposal, ...]:
    """Propose at most `most` positions, in the order in which they should be accepted. Each adds the most floor that no
    included viewpoint and no earlier proposal sees within `sees` meters, at least half a square meter. This greedy
    choice covers at least 1 - 1/e of the best possible choice of equal size (Nemhauser et al. 1978).

    Only floor that a disc of `radius` meters reaches from the viewpoints counts. Viewpoints within `reach` meters can
    be joined. The map covers one floor: pass a graph of that floor only.
    """
    from nvsim.occupancy.paths import clearance, reachable

    held = [v for v in graph.viewpoints.values() if v.included]
    if not held:
        return ()
    floor = _Floor(occupancy, reachable(occupancy, np.array([v.position[:2] for v in held]), radius), sees)
    for v in held:
        floor.mark_seen(floor.newly_visible(v.position[:2]))
    room = clearance(occupancy)
    waiting: list[NDArray[np.int64]] = []
    order = []
    for place in _candidates(occupancy, floor.missing, room, radius):
        seen = floor.newly_visible(place)
        # Among positions that see equally much, prefer the one with more room around it.
        comfort = min(1.0, float(room[tuple(occupancy.index(np.array(place)).tolist())]) / (_ROOM * radius))
        order.append((-len(seen), -comfort, *place, len(waiting)))
        waiting.append(seen)
    heapq.heapify(order)
    found: list[PlaceProposal] = []
    while order and len(found) < most:
        count, comfort, x, y, index = heapq.heappop(order)
        left = floor.still_missing(waiting[index])
        if len(left) * floor.each < _LEAST:
            continue
        if len(left) < -count:
            # Other proposals have covered a part of it. Gains only shrink, so the position goes back into the queue.
            heapq.heappush(order, (-len(left), comfort, x, y, index))
            continue
        floor.mark_seen(left)
        gain = len(left) * floor.each
        share = min(1.0, gain / (math.pi * sees * sees))
        proposal = _proposal(graph, (x, y), gain, share, held, room >= radius, occupancy, reach)
        found.append(proposal)
        held.append(Viewpoint(proposal.new_id, proposal.position, proposal.height))
    return tuple(found)


class _Floor:
    """Samples of the floor at cell centers, at most _GRAIN apart, and which of them are not seen yet.

    each   square meters per sample
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
        """(M, 2) row and column of the samples that are not seen yet."""
        return np.asarray(self._cells[self._unseen])

    def newly_visible(self, place: tuple[float, float]) -> NDArray[np.int64]:
        """Return the samples that are not seen yet and visible from `place` (x, y)."""
        from nvsim.occupancy.paths import segments_are_free

        near = self.still_missing(np.array(self._tree.query_ball_point(place, self._sees + 1e-9), np.int64))
        starts = np.broadcast_to(np.array(place), (len(near), 2))
        return np.asarray(near[segments_are_free(self._free, self._map, starts, self._xy[near])])

    def still_missing(self, samples: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.asarray(samples[self._unseen[samples]])

    def mark_seen(self, samples: NDArray[np.int64]) -> None:
        """Mark samples as seen."""
        self._unseen[samples] = False


def _candidates(
    occupancy: OccupancyMap, missing: NDArray[np.int64], room: NDArray[np.float64], radius: float
) -> list[tuple[float, float]]:
    """Return the cell with the most room for every square of a coarse grid with missing floor (M, 2)."""
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
    to = "no viewpoint nearby can be reached in a straight line"
    if joins:
        to = f"it can be joined to {' and '.join(map(graph.short, joins))}"
    words = f"{gain:.1f} m² of floor that no viewpoint sees from nearby; {to}."
    position = (*place, level.position[2])
    return PlaceProposal(new_id(graph, position), position, level.height, gain, joins, score, words)
