"""The kernel of `GridWays`; imported where it is called, as numba takes its time."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def spread(
    room: NDArray[np.bool_],  # (rows, columns)
    prices: NDArray[np.float64],  # (rows, columns), or (0, 0) for 1 everywhere
    first: int,  # the cell to begin at, numbered row by row
    resolution: float,  # metres
    reach: float,  # metres
    wanted: NDArray[np.bool_],  # (rows, columns), or (0, 0) where count is below 0
    count: int,  # of cells that are True in `wanted`, after which the rest is left; below 0 for all cells
    steps: NDArray[np.int64],  # (16, 6), see `grid_ways._steps`
    metres: NDArray[np.float64],  # (rows, columns) out, infinite before
    before: NDArray[np.int32],  # (rows * columns,) out, the cell that a way comes from; -1 before
) -> None:
    # A heap of the cells that wait, the nearest on top, each once: `place` is where, -1 before, -2 when it is settled.
    rows, columns = room.shape
    heap = np.empty(rows * columns, np.int32)
    place = np.full(rows * columns, -1, np.int32)
    far, free = metres.reshape(-1), room.reshape(-1)
    prices, wanted = prices.reshape(-1), wanted.reshape(-1)
    lengths = np.empty(len(steps))
    for k in range(len(steps)):
        lengths[k] = math.sqrt(steps[k, 0] ** 2 + steps[k, 1] ** 2) * resolution
    far[first], heap[0], place[first], waiting = 0.0, first, 0, 1
    while waiting:
        cell = heap[0]
        place[cell] = -2
        waiting -= 1
        if waiting:
            _sink(heap, place, far, heap[waiting], waiting)
        if count >= 0 and wanted[cell]:
            count -= 1
        if count == 0:
            break
        row, column = cell // columns, cell % columns
        for k in range(len(steps)):
            r, c = row + steps[k, 0], column + steps[k, 1]
            if r < 0 or c < 0 or r >= rows or c >= columns:
                continue
            other = r * columns + c
            if not free[other] or place[other] == -2:
                continue
            # Between its ends a step touches cells of the rows and columns that these have.
            if not (
                free[(row + steps[k, 2]) * columns + column + steps[k, 3]]
                and free[(row + steps[k, 4]) * columns + column + steps[k, 5]]
            ):
                continue
            length = lengths[k]
            if len(prices):
                length = length * (prices[cell] + prices[other]) / 2
            metre = far[cell] + length
            if metre > reach or metre >= far[other]:
                continue
            far[other], before[other] = metre, cell
            if place[other] == -1:
                place[other] = waiting
                heap[waiting] = other
                waiting += 1
            _rise(heap, place, far, place[other])
    # What still waits was met, but perhaps not by its shortest way.
    for k in range(waiting):
        far[heap[k]], before[heap[k]] = np.inf, -1


@njit(cache=True, nogil=True)
def _rise(heap: NDArray[np.int32], place: NDArray[np.int32], far: NDArray[np.float64], at: int) -> None:
    cell = heap[at]
    while at > 0:
        above = (at - 1) >> 1
        if far[heap[above]] <= far[cell]:
            break
        heap[at] = heap[above]
        place[heap[at]] = at
        at = above
    heap[at] = cell
    place[cell] = at


@njit(cache=True, nogil=True)
def _sink(heap: NDArray[np.int32], place: NDArray[np.int32], far: NDArray[np.float64], cell: int, count: int) -> None:
    at = 0
    while True:
        below = 2 * at + 1
        if below >= count:
            break
        if below + 1 < count and far[heap[below + 1]] < far[heap[below]]:
            below += 1
        if far[cell] <= far[heap[below]]:
            break
        heap[at] = heap[below]
        place[heap[at]] = at
        at = below
    heap[at] = cell
    place[cell] = at
