"""An occupancy map: free, occupied, and unknown cells on a regular grid over the ground."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

FREE, OCCUPIED, UNKNOWN = np.uint8(0), np.uint8(1), np.uint8(2)


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """cells       (rows, columns) uint8, FREE, OCCUPIED or UNKNOWN; row 0 has the lowest y, column 0 the lowest x
    resolution  meters per cell
    origin      (x, y) meters of the lower corner of cell [0, 0]
    notes       sentences for the user about how the file was read, such as an image that was found elsewhere
    """

    cells: NDArray[np.uint8]
    resolution: float
    origin: tuple[float, float]
    notes: tuple[str, ...] = ()

    @cached_property
    def room(self) -> NDArray[np.float32]:
        """(rows, columns) float32: lower bound, in cells, of the distance to the nearest occupied cell; 0 if occupied.

        It is 0.7 times the number of steps along rows and columns, because a straight line has at least that length.
        The result is cached."""
        steps = np.where(self.cells == OCCUPIED, 0, 10**6).astype(np.int32)
        for lines in (steps, steps.T):
            for run in (lines, lines[::-1]):
                for before, line in zip(run[:-1], run[1:], strict=True):
                    np.minimum(line, before + 1, out=line)
        return (steps * np.float32(0.7)).astype(np.float32)

    def index(self, xy: NDArray[np.floating]) -> NDArray[np.int64]:
        """(..., 2) int64 row and column of world points (..., 2), meters; may be outside the grid."""
        columns = np.floor((xy[..., 0] - self.origin[0]) / self.resolution)
        rows = np.floor((xy[..., 1] - self.origin[1]) / self.resolution)
        return np.stack([rows, columns], axis=-1).astype(np.int64)

    def at(self, xy: NDArray[np.floating]) -> NDArray[np.uint8]:
        """(...,) uint8 state at world points (..., 2), meters; UNKNOWN outside the grid."""
        index = self.index(np.asarray(xy, np.float64))
        rows, columns = self.cells.shape
        inside = (index[..., 0] >= 0) & (index[..., 0] < rows) & (index[..., 1] >= 0) & (index[..., 1] < columns)
        r, c = np.where(inside, index[..., 0], 0), np.where(inside, index[..., 1], 0)
        return np.where(inside, self.cells[r, c], UNKNOWN)

    def centres(self) -> NDArray[np.float64]:
        """(rows, columns, 2) float64 world x, y of the cell centers, meters."""
        rows, columns = self.cells.shape
        x = self.origin[0] + (np.arange(columns) + 0.5) * self.resolution
        y = self.origin[1] + (np.arange(rows) + 0.5) * self.resolution
        return np.stack(np.meshgrid(x, y), axis=-1)
