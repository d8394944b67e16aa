"""Compiled kernels that read a regular grid at many places. Import this module on use, because numba loads slowly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry import grid_values
from nvsim.kernels import njit

bilinear = njit(cache=True, nogil=True, error_model="numpy")(grid_values.bilinear)


@njit(cache=True, nogil=True, error_model="numpy")
def look_up_cells(
    cells: NDArray[np.bool_],  # (rows, columns)
    x: float,  # world x of the lower corner of cell [0, 0]
    y: float,  # world y of the lower corner of cell [0, 0]
    spacing: float,  # of cells
    places: NDArray[np.floating],  # (N, 2 or more) world x, y
    found: NDArray[np.bool_],  # (N,) output: value of the cell; False outside the grid and at NaN
) -> None:
    """Look up `cells` (rows, columns) at `places` (N, 2 or more) and write the result to `found` (N,)."""
    rows, columns = cells.shape
    for i in range(len(places)):
        c, r = np.floor((places[i, 0] - x) / spacing), np.floor((places[i, 1] - y) / spacing)
        found[i] = 0 <= c < columns and 0 <= r < rows and cells[int(r), int(c)]
