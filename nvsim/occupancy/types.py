"""An occupancy map: free, occupied, and unknown cells on a regular grid over the ground; its frame, its comparison, and
the height band in which objects are obstacles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError

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

    def states_at(self, xy: NDArray[np.floating]) -> NDArray[np.uint8]:
        """(...,) uint8 state at world points (..., 2), meters; UNKNOWN outside the grid."""
        index = self.index(np.asarray(xy, np.float64))
        rows, columns = self.cells.shape
        inside = (index[..., 0] >= 0) & (index[..., 0] < rows) & (index[..., 1] >= 0) & (index[..., 1] < columns)
        r, c = np.where(inside, index[..., 0], 0), np.where(inside, index[..., 1], 0)
        return np.where(inside, self.cells[r, c], UNKNOWN)

    def centers(self) -> NDArray[np.float64]:
        """(rows, columns, 2) float64 world x, y of the cell centers, meters."""
        rows, columns = self.cells.shape
        x = self.origin[0] + (np.arange(columns) + 0.5) * self.resolution
        y = self.origin[1] + (np.arange(rows) + 0.5) * self.resolution
        return np.stack(np.meshgrid(x, y), axis=-1)


_SAME = 1e-4  # rad: 1 cm over 100 m
_ROWS = 256  # rows that are processed at a time


def transformed_map(
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
        part[:] = occupancy.states_at((strip.centers() - shift) @ turn / scale)
    return new


_NAMES = {"free": FREE, "occupied": OCCUPIED, "unknown": UNKNOWN}


def compare_maps(found: OccupancyMap, true: OccupancyMap) -> dict[str, Any]:
    """Metrics of `found` at the centers of the cells of `true`. Both maps must be in one frame.

    free_found_free, _occupied, _unknown      shares of the truly free cells with each state in `found`; None without
                                              free cells
    occupied_found_free, _occupied, _unknown  shares of the truly occupied cells; the first should be 0, because such
                                              cells lead into obstacles; insides of walls are unknown to every sensor
    free_cells, occupied_cells                numbers of truly free and occupied cells
    beside_m2                                 square meters that are free in `found` and unknown in `true`
    """
    at = found.states_at(true.centers())
    figures: dict[str, Any] = {}
    for name in ("free", "occupied"):
        chosen = at[true.cells == _NAMES[name]]
        for what, state in _NAMES.items():
            figures[f"{name}_found_{what}"] = round(float((chosen == state).mean()), 4) if len(chosen) else None
        figures[f"{name}_cells"] = len(chosen)
    beside = (found.cells == FREE) & (true.states_at(found.centers()) == UNKNOWN)
    figures["beside_m2"] = round(float(np.count_nonzero(beside)) * found.resolution**2, 2)
    return figures


@dataclass(frozen=True)
class Heights:
    """Heights over the floor between which objects are obstacles. Raises InputError if the band is empty or too
    large."""

    from_height: float = 0.1
    """Meters over the floor, for a map from 3D data: lower objects can be stepped over."""
    to_height: float = 1.5
    """Meters over the floor: higher objects can be walked under."""

    def __post_init__(self) -> None:
        if not -1e3 < self.from_height < self.to_height < 1e3:
            raise InputError(
                f"The band from {self.from_height:g} to {self.to_height:g} m over the floor is empty or too large; "
                "give --from-height a smaller number of meters than --to-height."
            )
