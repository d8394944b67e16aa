"""How long the shortest way over a map is, around everything that stands on it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.occupancy.paths import FloatArray, segments_are_free
from nvsim.occupancy.types import OccupancyMap

ERROR = 0.028
"""Share by which a way around a corner comes out too long at the most: its legs are laid from steps in 16 directions,
of which the worst lies between two by 1/cos(13.3 degrees). A straight way is exact."""
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1))  # the other eight are these backwards


class Geodesics:
    """Shortest ways over the cells that are True in `room` (rows, columns), a set such as `standing_room` gives."""

    def __init__(self, room: NDArray[np.bool_], occupancy: OccupancyMap) -> None:
        self._room, self._occupancy = room, occupancy
        self._node = np.full(room.shape, -1, np.int64)
        self._node[room] = np.arange(int(room.sum()))
        self._matrix = steps_between(room, self._node, occupancy.resolution)

    def __len__(self) -> int:
        """Cells that can be walked on."""
        return int(self._matrix.shape[0])

    def lengths(self, start: FloatArray, ends: FloatArray) -> NDArray[np.float64]:
        """(N,) metres from the world point `start` (2,) to `ends` (N, 2); NaN where one of the two is not in the room,
        infinite where no way leads. Too long by ERROR at the most, and by half a cell at either end."""
        from scipy.sparse.csgraph import dijkstra

        start, ends = np.asarray(start, np.float64).reshape(1, 2), np.asarray(ends, np.float64).reshape(-1, 2)
        first, last = int(self._at(start)[0]), self._at(ends)
        found = np.full(len(ends), np.nan)
        if first < 0:
            return found
        inside = last >= 0
        found[inside] = dijkstra(self._matrix, directed=False, indices=first)[last[inside]]
        starts = np.broadcast_to(start, ends.shape)
        straight = np.linalg.norm(ends - start, axis=1)
        free = inside & segments_are_free(self._room, self._occupancy, starts, ends)
        found[free] = straight[free]
        return np.asarray(np.maximum(found, straight))

    def _at(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """(N,) the node of every point's cell, -1 outside the room."""
        index = self._occupancy.index(xy)
        inside = ((index >= 0) & (index < self._room.shape)).all(axis=1)
        found = np.full(len(xy), -1, np.int64)
        found[inside] = self._node[index[inside, 0], index[inside, 1]]
        return found


def steps_between(
    room: NDArray[np.bool_], node: NDArray[np.int64], resolution: float, dearer: NDArray[np.float64] | None = None
) -> Any:
    """The steps between cells in `room` (rows, columns), numbered by `node`, as a sparse matrix of metres, each one
    way. A slanted step needs the cells that it cuts, too. Where there is `dearer` (rows, columns), a step counts as so
    many times its length as the mean of its ends says."""
    from scipy.sparse import coo_matrix

    rows, columns = room.shape
    starts, stops, metres = [], [], []
    for dr, dc in _STEPS:
        low, high = max(0, -dc), max(0, columns - max(0, dc))
        here = (slice(0, max(0, rows - dr)), slice(low, high))

        def moved(r: int, c: int, height: int = dr, low: int = low, high: int = high) -> tuple[slice, slice]:
            return slice(r, max(r, rows - height + r)), slice(low + c, max(low + c, high + c))

        free = room[here] & room[moved(dr, dc)]
        for r, c in _cut(dr, dc):
            free &= room[moved(r, c)]
        starts.append(node[here][free])
        stops.append(node[moved(dr, dc)][free])
        length = np.full(int(free.sum()), np.hypot(dr, dc) * resolution)
        metres.append(length if dearer is None else length * (dearer[here] + dearer[moved(dr, dc)])[free] / 2)
    count = int(room.sum())
    pairs = (np.concatenate(starts), np.concatenate(stops))
    return coo_matrix((np.concatenate(metres), pairs), shape=(count, count)).tocsr()


def _cut(dr: int, dc: int) -> list[tuple[int, int]]:
    """The cells between the ends that a step touches."""
    side = 1 if dc > 0 else -1
    if abs(dr * dc) == 1:
        return [(1, 0), (0, side)]
    if dr == 2:
        return [(1, 0), (1, side)]
    return [(0, side), (1, side)] if abs(dc) == 2 else []
