"""Transform a map to another frame: rotate, translate, and scale it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.occupancy.types import UNKNOWN, OccupancyMap

_SAME = 1e-4  # rad: 1 cm over 100 m
_ROWS = 256  # rows that are processed at a time


def turned(
    occupancy: OccupancyMap,
    turn: NDArray[np.float64],
    shift: tuple[float, float] = (0.0, 0.0),
    scale: float = 1.0,
) -> OccupancyMap:
    """The map with every point p moved to scale * turn @ p + shift; `turn` (2, 2) is a rotation, `shift` in meters.

    Rotation by right angles loses nothing. Otherwise each cell of the new grid has the state of the old map at its
    center. The new grid is equally fine, so a wall of one cell stays closed to steps along rows and columns.
    """
    resolution = occupancy.resolution * scale
    rows, columns = occupancy.cells.shape
    size = np.array([columns, rows]) * occupancy.resolution
    corners = np.array(occupancy.origin) + np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * size
    placed = scale * corners @ turn.T + shift
    low, high = placed.min(axis=0), placed.max(axis=0)
    angle = float(np.arctan2(turn[1, 0], turn[0, 0]))
    quarter = round(angle / (np.pi / 2))
    if abs(angle - quarter * np.pi / 2) <= _SAME:
        # Rows go up in a map, and down in an image.
        middle = (placed.min(axis=0) + placed.max(axis=0)) / 2
        cells = np.ascontiguousarray(np.rot90(occupancy.cells, -quarter))
        low = middle - np.array(cells.shape[::-1]) * resolution / 2
        if quarter == 0:
            low = scale * np.array(occupancy.origin) @ turn.T + shift
        return OccupancyMap(cells, resolution, (float(low[0]), float(low[1])), occupancy.notes)
    shape = np.ceil((high - low) / resolution - 1e-9).astype(int)[::-1]
    corner = float(low[0]), float(low[1])
    new = OccupancyMap(np.full(shape, UNKNOWN, np.uint8), resolution, corner, occupancy.notes)
    for first in range(0, len(new.cells), _ROWS):
        part = new.cells[first : first + _ROWS]
        strip = OccupancyMap(part, resolution, (new.origin[0], new.origin[1] + first * resolution))
        part[:] = occupancy.at((strip.centres() - shift) @ turn / scale)
    return new
