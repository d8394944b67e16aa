"""The compiled kernel of `distance_to`. Import this module on use, because numba loads slowly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit


@njit(cache=True, nogil=True)
def nearest(
    places: NDArray[np.float32],  # (N, 3) meters, sorted by cell
    cells: NDArray[np.int64],  # (C,) numbers of the non-empty cells, ascending
    first: NDArray[np.int64],  # (C + 1,) index of the first place of each cell
    row: int,  # difference between the numbers of neighboring cells along y
    layer: int,  # difference between the numbers of neighboring cells along z
    count: int,  # rank of the neighbor whose distance is computed, the point itself included
    side: float,  # of a cell, meters
    whole: bool,  # whether the cells around a cell contain all points
    begin: int,  # first cell to process
    end: int,  # cell after the last one
    apart: NDArray[np.float32],  # (N,) meters; NaN entries are computed, and stay NaN if these cells are not enough
) -> None:
    """Compute the distance from each of `places` (N, 3) with NaN in `apart` (N,) to its neighbor of rank `count`."""
    # Cells and their neighbors are visited in ascending order of their numbers, so nine fingers only move forward.
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
            x, y, z = np.float64(places[i, 0]), np.float64(places[i, 1]), np.float64(places[i, 2])
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
