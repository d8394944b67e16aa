"""Shortest ways over the cells of a grid, from one of them to all others: Dijkstra's algorithm with steps in 16
directions, in a kernel of its own because a map asks for thousands of small ones. A matrix of steps, which the
algorithm of scipy wants, takes longer to make than to search."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

ERROR = 0.028
"""Share by which a way around a corner comes out too long at the most: its legs are laid from steps in 16 directions,
of which the worst lies between two by 1/cos(13.3 degrees). A straight way is exact."""

Cell = tuple[int, int]
_ALIKE = np.zeros((0, 0))


def _steps() -> NDArray[np.int64]:
    """(16, 6) rows and columns that a step goes, and those of the two cells that it touches between its ends; (0, 0),
    where it starts, for one that touches none."""
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
    """metres (rows, columns) from `start` to every cell that was reached, infinite elsewhere."""

    def __init__(
        self,
        room: NDArray[np.bool_],
        resolution: float,
        start: Cell,
        *,
        dearer: NDArray[np.float64] | None = None,
        ends: NDArray[np.int64] | None = None,
        reach: float = math.inf,
    ) -> None:
        """Over the cells (row, column) that are True in `room` (rows, columns), as if `start` were; a slanted step
        needs the cells that it cuts, too. Where there is `dearer` (rows, columns), at least 0, a step counts as so many
        times its length as the mean of its ends says. Nothing farther than `reach` is looked for, and with `ends`
        (N, 2) nothing farther than the farthest of these."""
        from nvsim.occupancy.spreading import spread

        rows, columns = room.shape
        self._columns, self._start = columns, start
        self.metres, self._before = np.full((rows, columns), np.inf), np.full(rows * columns, -1, np.int32)
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
        prices = _ALIKE if dearer is None else np.ascontiguousarray(dearer, np.float64)
        first = start[0] * columns + start[1]
        spread(open_cells, prices, first, resolution, reach, wanted, count, _STEPS, self.metres, self._before)

    def cells_to(self, end: Cell) -> NDArray[np.int64]:
        """(K, 2) cells from the start to one that was reached, both included."""
        cells = [end[0] * self._columns + end[1]]
        while self._before[cells[-1]] >= 0:
            cells.append(int(self._before[cells[-1]]))
        return np.stack(np.divmod(np.array(cells[::-1]), self._columns), axis=1)
