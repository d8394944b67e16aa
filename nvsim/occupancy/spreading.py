"""The compiled kernel of `GridWays`. Import this module on use, because numba loads slowly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit


@njit(cache=True, nogil=True)
def measure_paths(
    room: NDArray[np.bool_],  # (rows, columns)
    prices: NDArray[np.float64],  # (rows, columns), or (0, 0) for 1 everywhere
    first: int,  # the start cell, numbered row by row
    resolution: float,  # meters
    reach: float,  # meters
    wanted: NDArray[np.bool_],  # (rows, columns), or (0, 0) if count is below 0
    count: int,  # of cells that are True in `wanted`; the search stops when all are reached; below 0 for no stop
    steps: NDArray[np.int64],  # (16, 6), see `grid_ways._steps`
    meters: NDArray[np.float64],  # (rows, columns) output, initially infinite
    before: NDArray[np.int32],  # (rows * columns,) output, the previous cell on the path; initially -1
) -> None:
    """Compute shortest path lengths `meters` (rows, columns) from the cell `first` over the True cells of `room`."""
    # A heap of the waiting cells, nearest on top. `place` is the position of a cell in it; -1 initially, -2 if settled.
    rows, columns = room.shape
    heap = np.empty(rows * columns, np.int32)
    place = np.full(rows * columns, -1, np.int32)
    far, free = meters.reshape(-1), room.reshape(-1)
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
            _sift_down(heap, place, far, heap[waiting], waiting)
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
            # The cells that a step touches between its ends are in the rows and columns of its ends.
            if not (
                free[(row + steps[k, 2]) * columns + column + steps[k, 3]]
                and free[(row + steps[k, 4]) * columns + column + steps[k, 5]]
            ):
                continue
            length = lengths[k]
            if len(prices):
                length = length * (prices[cell] + prices[other]) / 2
            meter = far[cell] + length
            if meter > reach or meter >= far[other]:
                continue
            far[other], before[other] = meter, cell
            if place[other] == -1:
                place[other] = waiting
                heap[waiting] = other
                waiting += 1
            _sift_up(heap, place, far, place[other])
    # The cells that still wait may not have their shortest path.
    for k in range(waiting):
        far[heap[k]], before[heap[k]] = np.inf, -1


@njit(cache=True, nogil=True)
def _sift_up(heap: NDArray[np.int32], place: NDArray[np.int32], far: NDArray[np.float64], at: int) -> None:
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
def _sift_down(
    heap: NDArray[np.int32], place: NDArray[np.int32], far: NDArray[np.float64], cell: int, count: int
) -> None:
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
