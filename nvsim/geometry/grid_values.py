"""The value of a regular grid at places, in plain Python: for a few at once, and what `grid_kernels` compiles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def bilinear(
    grid: NDArray[np.float32],  # (rows, columns), none of them 0
    x: float,  # world, of the middle of cell [0, 0]; as y
    y: float,
    spacing: float,  # between middles
    places: NDArray[np.float64],  # (N, 2 or more) world x, y
    found: NDArray[np.float32],  # (N,) out: beyond the border the nearest border value, NaN at places that are NaN
) -> None:
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
