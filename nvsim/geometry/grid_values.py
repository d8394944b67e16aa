"""The value of a regular grid at places, in plain Python. Used for few places, and compiled by `grid_kernels`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def bilinear(
    grid: NDArray[np.float32],  # (rows, columns), not empty
    x: float,  # world x of the center of cell [0, 0]
    y: float,  # world y of the center of cell [0, 0]
    spacing: float,  # between centers
    places: NDArray[np.float64],  # (N, 2 or more) world x, y
    found: NDArray[np.float32],  # (N,) output: the nearest border value outside the grid, NaN at NaN
) -> None:
    """Interpolate `grid` (rows, columns) bilinearly at `places` (N, 2 or more) and write the result to `found` (N,)."""
    rows, columns = grid.shape
    for i in range(len(places)):
        c, r = (places[i, 0] - x) / spacing, (places[i, 1] - y) / spacing
        if np.isnan(c) or np.isnan(r):
            found[i] = np.nan
            continue
        c, r = min(max(c, 0.0), columns - 1.0), min(max(r, 0.0), rows - 1.0)
        c0, r0 = int(c), int(r)
        c1, r1 = min(c0 + 1, columns - 1), min(r0 + 1, rows - 1)
        along, up = np.float32(c - c0), np.float32(r - r0)
        one = np.float32(1.0)
        low = grid[r0, c0] * (one - along) + grid[r0, c1] * along
        high = grid[r1, c0] * (one - along) + grid[r1, c1] * along
        found[i] = low * (one - up) + high * up
