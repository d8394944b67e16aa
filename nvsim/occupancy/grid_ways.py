"""Shortest paths over the cells of a grid, from one cell to all others.

This is Dijkstra's algorithm with steps in 16 directions. It has its own kernel, because a map needs thousands of small
searches. Creating the sparse matrix for scipy's algorithm would take longer than the search. `Geodesics` measures paths
on an occupancy map with it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.occupancy.paths import FloatArray, segments_are_free
from nvsim.occupancy.types import OccupancyMap

ERROR = 0.028
"""Largest share by which a path around a corner is too long. Its segments consist of steps in 16 directions, and the
worst direction between two of them is too long by 1/cos(13.3 degrees). A straight path is exact."""

Cell = tuple[int, int]
_ALIKE = np.zeros((0, 0))


def _steps() -> NDArray[np.int64]:
    """(16, 6) row and column offset of each step, and of the two cells that it touches between its ends. A step that
    touches no other cell has (0, 0), its start."""
    found = []
    for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1), (1, 2), (2, 1), (1, -2), (2, -1)):
        side = 1 if columns > 0 else -1
        touched = [(0, 0), (0, 0)]
        if abs(rows * columns) == 1:
            touched = [(1, 0), (0, side)]
        elif rows == 2:
            touched = [(1, 0), (1, side)]
        elif abs(columns) == 2:
            touched = [(0, side), (1, side)]
        for way in (1, -1):
            found.append([way * value for pair in ((rows, columns), *touched) for value in pair])
    return np.array(found)


_STEPS = _steps()


class GridWays:
    """`meters` (rows, columns) float64: path length from `start` to every reached cell, infinite elsewhere."""

    def __init__(
        self,
        room: NDArray[np.bool_],
        resolution: float,
        start: Cell,
        *,
        cost_factors: NDArray[np.float64] | None = None,
        ends: NDArray[np.int64] | None = None,
        reach: float = math.inf,
    ) -> None:
        """Search over the cells that are True in `room` (rows, columns) bool; the cell `start` always counts as True.

        A diagonal step also needs the cells that it cuts. `resolution` is meters per cell. `cost_factors` (rows,
        columns) float64 >= 0 are cost factors: the length of a step is multiplied by their mean at its ends. Cells
        farther than `reach` meters are ignored. With `ends` (N, 2) int64, the search stops when all of them are
        reached."""
        from nvsim.occupancy.spreading import measure_paths

        rows, columns = room.shape
        self._columns, self._start = columns, start
        self.meters, self._before = np.full((rows, columns), np.inf), np.full(rows * columns, -1, np.int32)
        open_cells = np.ascontiguousarray(room, np.bool_)
        if not open_cells[start]:
            open_cells = open_cells.copy()
            open_cells[start] = True
        wanted, count = np.zeros((0, 0), np.bool_), -1
        if ends is not None:
            inside = ((ends >= 0) & (ends < room.shape)).all(axis=1)
            wanted = np.zeros(room.shape, np.bool_)
            wanted[ends[inside, 0], ends[inside, 1]] = True
            wanted &= open_cells
            count = int(wanted.sum())
        prices = _ALIKE if cost_factors is None else np.ascontiguousarray(cost_factors, np.float64)
        first = start[0] * columns + start[1]
        measure_paths(open_cells, prices, first, resolution, reach, wanted, count, _STEPS, self.meters, self._before)

    def cells_to(self, end: Cell) -> NDArray[np.int64]:
        """(K, 2) int64 row and column of the cells from the start to a reached cell `end`, both included."""
        cells = [end[0] * self._columns + end[1]]
        while self._before[cells[-1]] >= 0:
            cells.append(int(self._before[cells[-1]]))
        return np.stack(np.divmod(np.array(cells[::-1]), self._columns), axis=1)


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
        ).meters[row, column]
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
