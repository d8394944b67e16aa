"""Cells of grids over the ground. A grid that would not fit into memory is refused before it is created."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError

MOST_CELLS = 25_000_000
"""500 m by 500 m in cells of 0.1 m: larger than the largest buildings, and some hundred MB including derived data."""


def grid_size(
    low: NDArray[np.floating], high: NDArray[np.floating], spacing: float, of: str, most: int = MOST_CELLS
) -> tuple[int, int]:
    """(columns, rows) of cells of `spacing` meters between the corners `low` and `high` (2,), meters.

    `of` names the objects between the corners, in the plural. Raises InputError if there are more than `most` cells, or
    if the corners are not finite."""
    extent = np.asarray(high, np.float64)[:2] - np.asarray(low, np.float64)[:2]
    cells = np.ceil(extent / spacing)
    if not (np.isfinite(cells).all() and (cells >= 0).all() and (cells + 1).prod() <= most):
        raise InputError(
            f"{of[:1].upper()}{of[1:]} span {extent[0]:.4g} x {extent[1]:.4g} m, too much for a grid of {spacing:g} m; "
            "`nvsim check CAPTURE` names the frames with a wrong pose, and --leave-out NAME,... imports without them."
        )
    return int(cells[0]), int(cells[1])


def distinct_cells(cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The distinct rows (M, D) of `cells` (N, D) int64, in ascending order, and the index (N,) of each cell among them.

    The result equals np.unique(cells, axis=0, return_inverse=True), in a tenth of the time: it sorts numbers instead of
    rows."""
    if not len(cells):
        return cells, np.zeros(0, np.int64)
    low = cells.min(axis=0)
    sides = cells.max(axis=0) - low + 1
    if np.prod(sides.astype(np.float64)) > 2**62:
        found, member = np.unique(cells, axis=0, return_inverse=True)
        return found, member.reshape(-1)
    numbers, member = np.unique(np.ravel_multi_index(tuple((cells - low).T), tuple(sides)), return_inverse=True)
    return np.stack(np.unravel_index(numbers, tuple(sides)), axis=1) + low, member.reshape(-1)


def near_places(points: NDArray[np.floating], places: NDArray[np.floating], reach: float) -> NDArray[np.bool_]:
    """(N,) bool, True for `points` (N, 2 or 3) less than `reach` meters along the ground from one of `places`
    (P, 2 or 3).

    Distances are measured between cells of a meter, so some points up to two meters farther are also True."""
    from scipy.ndimage import distance_transform_edt

    from nvsim.geometry.grid_kernels import look_up_cells

    if not len(places):
        return np.zeros(len(points), bool)
    cells = np.floor(np.asarray(places, np.float64)[:, :2]).astype(np.int64)
    margin = int(np.ceil(reach)) + 3
    low = cells.min(axis=0) - margin
    columns, rows = grid_size(low, cells.max(axis=0) + margin + 1, 1.0, "the cameras")
    empty = np.ones((columns, rows), bool)
    empty[tuple((cells - low).T)] = False
    near = np.ascontiguousarray(np.transpose(distance_transform_edt(empty) < reach + 2**0.5))
    found = np.empty(len(points), np.bool_)
    look_up_cells(near, float(low[0]), float(low[1]), 1.0, points, found)
    return found
