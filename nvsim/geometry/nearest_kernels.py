"""The kernel of `distance_to`; imported where it is called, as numba takes its time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def nearest(
    places: NDArray[np.float64],  # (N, 3) metres, cell by cell
    cells: NDArray[np.int64],  # (C,) numbers of the cells that are not empty, ascending
    first: NDArray[np.int64],  # (C + 1,) the first place of each
    row: int,  # what the numbers of cells beside one another along y and z differ by
    layer: int,
    count: int,  # how many of the nearest there are, itself included, of which the farthest is asked for
    side: float,  # of a cell, metres
    whole: bool,  # whether there is nothing beyond the cells around a cell
    begin: int,  # of the cells
    end: int,
    apart: NDArray[np.float32],  # (N,) metres, NaN where it is asked for; stays so where it may lie beyond these cells
) -> None:
    # Cells come in the order of their numbers, and so do those around them: nine fingers move along.
    fingers = np.empty(9, np.int64)
    for j in range(9):
        shift = (j // 3 - 1) * layer + (j % 3 - 1) * row - 1
        fingers[j] = np.searchsorted(cells, cells[begin] + shift) if begin < end else 0
    best = np.empty(count)
    for at in range(begin, end):
        asked = False
        for i in range(first[at], first[at + 1]):
            asked = asked or np.isnan(apart[i])
        for j in range(9):
            least = cells[at] + (j // 3 - 1) * layer + (j % 3 - 1) * row - 1
            while fingers[j] < len(cells) and cells[fingers[j]] < least:
                fingers[j] += 1
        if not asked:
            continue
        for i in range(first[at], first[at + 1]):
            if not np.isnan(apart[i]):
                continue
            x, y, z = places[i]
            best[:] = np.inf
            for j in range(9):
                last = cells[at] + (j // 3 - 1) * layer + (j % 3 - 1) * row + 1
                other = fingers[j]
                while other < len(cells) and cells[other] <= last:
                    for k in range(first[other], first[other + 1]):
                        dx, dy, dz = x - places[k, 0], y - places[k, 1], z - places[k, 2]
                        away = dx * dx + dy * dy + dz * dz
                        if away < best[count - 1]:
                            n = count - 1
                            while n > 0 and best[n - 1] > away:
                                best[n] = best[n - 1]
                                n -= 1
                            best[n] = away
                    other += 1
            if whole or best[count - 1] <= side * side:
                apart[i] = np.sqrt(best[count - 1])
