"""The compiled kernels of `nearest_points`. Import this module on use, because numba loads slowly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit

_ROWS = np.array([4, 3, 5, 1, 7, 0, 2, 6, 8])  # of cells around a cell, the nearest first


@njit(cache=True, nogil=True)
def nearest(
    places: NDArray[np.float32],  # (N, 3) meters, sorted by cell
    cells: NDArray[np.int64],  # (C,) numbers of the non-empty cells, ascending
    first: NDArray[np.int64],  # (C + 1,) index of the first place of each cell
    row: int,  # difference between the numbers of neighboring cells along y
    layer: int,  # difference between the numbers of neighboring cells along z
    count: int,  # rank of the neighbor whose distance is computed, the point itself included
    low: NDArray[np.float64],  # (3,) meters, corner of the cells
    side: float,  # of a cell, meters
    whole: bool,  # whether the cells around a cell contain all points
    begin: int,  # first cell to process
    end: int,  # cell after the last one
    apart: NDArray[np.float32],  # (N,) meters; NaN entries are computed, and stay NaN if these cells are not enough
    normals: NDArray[np.float32],  # (N, 3), or (0, 3) if they are not wanted
) -> None:
    """Compute the distance from each of `places` (N, 3) with NaN in `apart` (N,) to its neighbor of rank `count`, and
    the direction in which these neighbors spread least."""
    # Cells and their neighbors are visited in ascending order of their numbers, so nine fingers only move forward.
    fingers = np.empty(9, np.int64)
    for j in range(9):
        shift = (j // 3 - 1) * layer + (j % 3 - 1) * row - 1
        fingers[j] = np.searchsorted(cells, cells[begin] + shift) if begin < end else 0
    best, index = np.empty(count), np.zeros(count, np.int64)
    gaps, wanted = np.zeros((3, 3)), len(normals) > 0
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
            for c in range(3):  # meters to the cells before and after the own one
                inside = (places[i, c] - low[c]) / side
                gaps[c, 0] = (inside - np.floor(inside)) * side
                gaps[c, 2] = side - gaps[c, 0]
            best[:] = np.inf
            for j in _ROWS:
                beside = gaps[1, j % 3] ** 2 + gaps[2, j // 3] ** 2
                own = cells[at] + (j // 3 - 1) * layer + (j % 3 - 1) * row
                other = fingers[j]
                while other < len(cells) and cells[other] <= own + 1:
                    if beside + gaps[0, cells[other] - own + 1] ** 2 < best[count - 1]:
                        for k in range(first[other], first[other + 1]):
                            dx, dy, dz = x - places[k, 0], y - places[k, 1], z - places[k, 2]
                            away = dx * dx + dy * dy + dz * dz
                            if away < best[count - 1]:
                                _enter(best, index, away, k)
                    other += 1
            if whole or best[count - 1] <= side * side:
                apart[i] = np.sqrt(best[count - 1])
                if wanted:
                    normals[i] = _least_axis(places, index)


@njit(cache=True, nogil=True)
def nearest_of_few(
    places: NDArray[np.float32],  # (N, 3) meters
    wanted: NDArray[np.int64],  # (K,) the places whose neighbors are searched among all places
    count: int,  # as in `nearest`
    apart: NDArray[np.float32],  # (K,) meters, is filled
    normals: NDArray[np.float32],  # (K, 3), is filled
) -> None:
    """What `nearest` computes, for a few places."""
    best, index = np.empty(count), np.zeros(count, np.int64)
    for i in range(len(wanted)):
        x, y, z = places[wanted[i], 0], places[wanted[i], 1], places[wanted[i], 2]
        best[:] = np.inf
        for k in range(len(places)):
            dx, dy, dz = np.float64(x) - places[k, 0], np.float64(y) - places[k, 1], np.float64(z) - places[k, 2]
            away = dx * dx + dy * dy + dz * dz
            if away < best[count - 1]:
                _enter(best, index, away, k)
        apart[i], normals[i] = np.sqrt(best[count - 1]), _least_axis(places, index)


@njit(cache=True, nogil=True)
def _enter(best: NDArray[np.float64], index: NDArray[np.int64], away: float, k: int) -> None:
    """Put a place into the ascending list `best` of the nearest ones, in place of the last."""
    n = len(best) - 1
    while n > 0 and best[n - 1] > away:
        best[n], index[n] = best[n - 1], index[n - 1]
        n -= 1
    best[n], index[n] = away, k


@njit(cache=True, nogil=True)
def _least_axis(places: NDArray[np.float32], index: NDArray[np.int64]) -> NDArray[np.float64]:
    """(3,) the unit direction in which `places[index]` spread least, of either sign."""
    middle, spread = np.zeros(3), np.zeros((3, 3))
    for k in index:
        for c in range(3):
            middle[c] += places[k, c] / len(index)
    for k in index:
        for c in range(3):
            for d in range(c, 3):
                spread[c, d] += (places[k, c] - middle[c]) * (places[k, d] - middle[d])
    axes = np.eye(3)  # Jacobi's method: turn two axes at a time until none of them are correlated
    for _ in range(12):
        largest = max(abs(spread[0, 1]), abs(spread[0, 2]), abs(spread[1, 2]))
        if largest <= 1e-14 * (spread[0, 0] + spread[1, 1] + spread[2, 2]):
            break
        for c, d in ((0, 1), (0, 2), (1, 2)):
            if spread[c, d] == 0:
                continue
            ratio = (spread[d, d] - spread[c, c]) / (2 * spread[c, d])
            tangent = 1 / (abs(ratio) + np.sqrt(ratio * ratio + 1))
            if ratio < 0:
                tangent = -tangent
            cosine = 1 / np.sqrt(tangent * tangent + 1)
            sine = tangent * cosine
            spread[c, c] -= tangent * spread[c, d]
            spread[d, d] += tangent * spread[c, d]
            spread[c, d] = 0
            e = 3 - c - d
            x, y = (min(c, e), max(c, e)), (min(d, e), max(d, e))
            spread[x], spread[y] = cosine * spread[x] - sine * spread[y], sine * spread[x] + cosine * spread[y]
            for k in range(3):
                axes[k, c], axes[k, d] = (
                    cosine * axes[k, c] - sine * axes[k, d],
                    sine * axes[k, c] + cosine * axes[k, d],
                )
    return axes[:, np.argmin(np.array([spread[0, 0], spread[1, 1], spread[2, 2]]))]
