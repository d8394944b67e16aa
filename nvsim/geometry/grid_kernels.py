"""Values of a regular grid at many places, in compiled code; imported where it is called, as numba takes its time."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.geometry import grid_values

bilinear = njit(cache=True, nogil=True, error_model="numpy")(grid_values.bilinear)


@njit(cache=True, nogil=True, error_model="numpy")
def marked(
    cells: NDArray[np.bool_],  # (rows, columns)
    x: float,  # world, of the lower corner of cell [0, 0]; as y
    y: float,
    spacing: float,  # of cells
    places: NDArray[np.floating],  # (N, 2 or more) world x, y
    found: NDArray[np.bool_],  # (N,) out: that of the cell; False beyond the grid and at places that are NaN
) -> None:
    rows, columns = cells.shape
    for i in range(len(places)):
        c, r = np.floor((places[i, 0] - x) / spacing), np.floor((places[i, 1] - y) / spacing)
        found[i] = 0 <= c < columns and 0 <= r < rows and cells[int(r), int(c)]
