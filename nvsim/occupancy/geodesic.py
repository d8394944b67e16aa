"""Lengths of the shortest paths on a map, around all obstacles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.occupancy.grid_ways import GridWays
from nvsim.occupancy.paths import FloatArray, segments_are_free
from nvsim.occupancy.types import OccupancyMap


class Geodesics:
    """Shortest paths over the cells that are True in `room` (rows, columns) bool, such as `standing_room` returns."""

    def __init__(self, room: NDArray[np.bool_], occupancy: OccupancyMap) -> None:
        self._room, self._occupancy = room, occupancy

    def __len__(self) -> int:
        """Number of traversable cells."""
        return int(self._room.sum())

    def lengths(self, start: FloatArray, ends: FloatArray) -> NDArray[np.float64]:
        """(N,) float64 path lengths in meters from the world point `start` (2,) to `ends` (N, 2), meters.

        NaN if the start or the end is not in the room, infinite if there is no path. A length is too long by a share of
        at most ERROR, and by half a cell at each end."""
        start, ends = np.asarray(start, np.float64).reshape(1, 2), np.asarray(ends, np.float64).reshape(-1, 2)
        first, last = self._cells_of_points(start)[0], self._cells_of_points(ends)
        found = np.full(len(ends), np.nan)
        if first[0] < 0:
            return found
        inside = last[:, 0] >= 0
        row, column = last[inside].T
        found[inside] = GridWays(
            self._room, self._occupancy.resolution, (int(first[0]), int(first[1])), ends=last[inside]
        ).metres[row, column]
        starts = np.broadcast_to(start, ends.shape)
        straight = np.linalg.norm(ends - start, axis=1)
        free = inside & segments_are_free(self._room, self._occupancy, starts, ends)
        found[free] = straight[free]
        return np.asarray(np.maximum(found, straight))

    def _cells_of_points(self, xy: NDArray[np.float64]) -> NDArray[np.int64]:
        """(N, 2) row and column of the cell of each point, -1 outside the room."""
        index = np.asarray(self._occupancy.index(xy), np.int64)
        inside: NDArray[np.bool_] = np.all((index >= 0) & (index < self._room.shape), axis=1)
        inside[inside] = self._room[index[inside, 0], index[inside, 1]]
        return np.where(inside[:, None], index, -1)
