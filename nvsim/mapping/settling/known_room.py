"""Paths over known floor that are wide enough for the robot. They show where a graph could lead before anything is
rendered."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.mapping.search.walk import Walk
from nvsim.occupancy.grid_ways import Cell, GridWays

_CELL = 0.1  # meters
_EASY = 0.6  # meters of room beside a path; more room is no advantage
_TIGHT = 2.0  # extra length of a path without any room, as a multiple of its length
_STOREY = 1.5  # minimum meters between cameras of two storeys


class KnownRoom:
    """Floor with at least `half_width` meters of known floor around it, at a resolution of 10 cm, without the areas
    that were closed."""

    def __init__(self, walk: Walk, half_width: float) -> None:
        self._walk, self.least = walk, half_width - _CELL / 2
        self._shut = np.zeros((0, 4))  # x, y, z, radius of closed areas, meters

    def shut(self, place: NDArray[np.floating], radius: float) -> None:
        """Close the floor within `radius` meters of a position (3,)."""
        self._shut = np.vstack([self._shut, [*place, radius]])

    @property
    def shuts(self) -> int:
        """Number of closed areas."""
        return len(self._shut)

    def shut_since(self, before: int, place: NDArray[np.floating], reach: float) -> bool:
        """Whether areas that were closed since `shuts` was `before` can affect `lengths` from a position (3,) over at
        most `reach` meters."""
        window = np.full(2, reach + _CELL)
        return len(self._shut_in(place[:2] - window, place[:2] + window, float(place[2]), before)) > 0

    def lengths(self, start: NDArray[np.floating], ends: NDArray[np.floating], reach: float) -> NDArray[np.float64]:
        """Return (N,) meters of the paths from one camera (3,) to others (N, 3). Infinite if there is no path of at
        most `reach` meters."""
        window = _Window(start, reach, self)
        cells = window.cells_of(ends)
        ways = window.ways(cells[cells[:, 0] >= 0], reach=reach)
        found = np.where(cells[:, 0] >= 0, ways.metres[cells[:, 0], cells[:, 1]], np.inf)
        return np.asarray(np.maximum(found, np.linalg.norm(ends[:, :2] - start[:2], axis=1)))

    def way(self, start: NDArray[np.floating], end: NDArray[np.floating], reach: float) -> NDArray[np.float64]:
        """Return (K, 3) positions, meters, of a path from one camera (3,) to another within `reach` meters, at the
        height of the first. The path prefers the middle of the room to the shortest line. Empty if there is no path."""
        window = _Window(start, reach, self)
        last = window.cells_of(np.asarray(end)[None])
        ways = window.ways(last, _TIGHT)
        if last[0, 0] < 0 or not np.isfinite(ways.metres[last[0, 0], last[0, 1]]):
            return np.zeros((0, 3))
        return window.places(ways.cells_to((int(last[0, 0]), int(last[0, 1]))))

    def clearance(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return (N,) meters from positions (N, 3) to the nearest unknown floor; 0 in closed areas."""
        found = self._walk.clearance_at(places)
        if len(places):
            low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
            for x, y, _, radius in self._shut_in(low, high, float(places[0, 2])):
                found[np.hypot(places[:, 0] - x, places[:, 1] - y) < radius] = 0.0
        return found

    def clearance_over(self, x: NDArray[np.float64], y: NDArray[np.float64], z: float) -> NDArray[np.float64]:
        """Return (rows, columns) clearances in meters for all positions with a coordinate of `y` (rows,) and of `x`
        (columns,), ascending, at the height z."""
        found = self._walk.clearance_over(x, y, z)
        for at_x, at_y, _, radius in self._shut_in(np.array([x[0], y[0]]), np.array([x[-1], y[-1]]), z):
            columns = slice(*np.searchsorted(x, [at_x - radius, at_x + radius]))
            rows = slice(*np.searchsorted(y, [at_y - radius, at_y + radius]))
            found[rows, columns][np.hypot(x[columns] - at_x, y[rows, None] - at_y) < radius] = 0.0
        return found

    def _shut_in(
        self, low: NDArray[np.floating], high: NDArray[np.floating], z: float, since: int = 0
    ) -> NDArray[np.float64]:
        """(K, 4) closed areas that reach into the box from `low` to `high` (2,) on the storey of a camera at z."""
        shut = self._shut[since:]
        x, y, at_z, radius = shut.T
        across = (x > low[0] - radius) & (x < high[0] + radius)
        along = (y > low[1] - radius) & (y < high[1] + radius)
        return shut[across & along & (np.abs(at_z - z) < _STOREY)]

    def is_wide(self, places: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return (N,) bool: whether the robot has room at positions (N, 3)."""
        return self.clearance(places) >= self.least


class _Window:
    """The cells within `reach` of a camera (3,), and which of them have room."""

    def __init__(self, camera: NDArray[np.floating], reach: float, floor: KnownRoom) -> None:
        half = int(np.ceil(reach / _CELL))
        self._side, self._camera = 2 * half + 1, np.asarray(camera, np.float64)
        self._start: Cell = half, half
        self._low = self._camera[:2] - (half + 0.5) * _CELL
        along = (np.arange(self._side) + 0.5) * _CELL
        self._x, self._y = self._low[0] + along, self._low[1] + along
        self._clearance = floor.clearance_over(self._x, self._y, float(self._camera[2]))
        self._room = self._clearance >= floor.least

    def cells_of(self, places: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N, 2) row and column of positions (N, 3) on the camera's storey; -1 if they are not in a cell with room."""
        column, row = np.floor((places[:, :2] - self._low) / _CELL).astype(np.int64).T
        inside = (row >= 0) & (column >= 0) & (row < self._side) & (column < self._side)
        inside &= np.abs(places[:, 2] - self._camera[2]) < _STOREY
        at = np.stack([row, column], axis=1)
        here = (at == self._start).all(axis=1)
        inside[inside] &= self._room[row[inside], column[inside]] | here[inside]
        at[~inside] = -1
        return at

    def places(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """(N, 3) centers of cells (N, 2) at the camera's height."""
        return np.column_stack([self._x[cells[:, 1]], self._y[cells[:, 0]], np.full(len(cells), self._camera[2])])

    def ways(self, ends: NDArray[np.int64], tight: float = 0.0, reach: float = math.inf) -> GridWays:
        """Return the paths to cells (N, 2). Where room is scarce, each step counts as longer, by up to `tight` times
        its length."""
        cost_factors = 1 + tight * np.clip(1 - self._clearance / _EASY, 0, 1) if tight else None
        return GridWays(self._room, _CELL, self._start, cost_factors=cost_factors, ends=ends, reach=reach)
