"""Ways over known floor that are wide enough for the robot: where a graph might lead, before anything is rendered."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.mapping.walk import Walk
from nvsim.occupancy.geodesic import steps_between

_CELL = 0.1  # metres
_EASY = 0.6  # metres of room beside a way from which on more of it makes it no better
_TIGHT = 2.0  # times as long, a way without any room counts on top
_STOREY = 1.5  # metres between cameras of two storeys, at least


class KnownRoom:
    """Floor that has `half_width` metres of known floor around it, as far as a cell of 10 cm tells, less what was
    shut."""

    def __init__(self, walk: Walk, half_width: float) -> None:
        self._walk, self.least = walk, half_width - _CELL / 2
        self._shut = np.zeros((0, 4))  # x, y, z, radius, metres

    def shut(self, place: NDArray[np.floating], radius: float) -> None:
        """Takes the floor within `radius` metres of a place (3,) for closed."""
        self._shut = np.vstack([self._shut, [*place, radius]])

    @property
    def shuts(self) -> int:
        """How often something was shut."""
        return len(self._shut)

    def shut_since(self, before: int, place: NDArray[np.floating], reach: float) -> bool:
        """Whether anything was shut that `lengths` from a place (3,) over at most `reach` metres depends on, since
        `shuts` was `before`."""
        window = np.full(2, reach + _CELL)
        return len(self._shut_in(place[:2] - window, place[:2] + window, float(place[2]), before)) > 0

    def lengths(self, start: NDArray[np.floating], ends: NDArray[np.floating], reach: float) -> NDArray[np.float64]:
        """(N,) metres from one camera (3,) to others (N, 3); infinite where no way of at most `reach` metres leads."""
        from scipy.sparse.csgraph import dijkstra

        window = _Window(start, reach, self)
        metres = dijkstra(window.steps(tight=0.0), directed=False, indices=window.start, limit=reach)
        at = window.nodes_at(ends)
        found = np.where(at >= 0, metres[at], np.inf)
        return np.asarray(np.maximum(found, np.linalg.norm(ends[:, :2] - start[:2], axis=1)))

    def way(self, start: NDArray[np.floating], end: NDArray[np.floating], reach: float) -> NDArray[np.float64]:
        """(K, 3) places from one camera (3,) to another within `reach` metres of it, at the height of the first, rather
        in the middle of the room that there is than the shortest; none where no way leads."""
        from scipy.sparse.csgraph import dijkstra

        window = _Window(start, reach, self)
        matrix, last = window.steps(_TIGHT), int(window.nodes_at(np.asarray(end)[None])[0])
        if last < 0:
            return np.zeros((0, 3))
        metres, before = dijkstra(matrix, directed=False, indices=window.start, return_predecessors=True)
        if not np.isfinite(metres[last]):
            return np.zeros((0, 3))
        nodes = [last]
        while nodes[-1] != window.start:
            nodes.append(int(before[nodes[-1]]))
        return window.places[nodes[::-1]]

    def clearance(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """(N,) metres around places (N, 3) to the nearest floor that nobody knows; 0 where it was shut."""
        found = self._walk.clearance_at(places)
        if len(places):
            low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
            for x, y, _, radius in self._shut_in(low, high, float(places[0, 2])):
                found[np.hypot(places[:, 0] - x, places[:, 1] - y) < radius] = 0.0
        return found

    def clearance_over(self, x: NDArray[np.float64], y: NDArray[np.float64], z: float) -> NDArray[np.float64]:
        """(rows, columns) the same for every place with one of the coordinates `y` (rows,) and one of `x` (columns,),
        ascending, at the height z."""
        found = self._walk.clearance_over(x, y, z)
        for at_x, at_y, _, radius in self._shut_in(np.array([x[0], y[0]]), np.array([x[-1], y[-1]]), z):
            columns = slice(*np.searchsorted(x, [at_x - radius, at_x + radius]))
            rows = slice(*np.searchsorted(y, [at_y - radius, at_y + radius]))
            found[rows, columns][np.hypot(x[columns] - at_x, y[rows, None] - at_y) < radius] = 0.0
        return found

    def _shut_in(
        self, low: NDArray[np.floating], high: NDArray[np.floating], z: float, since: int = 0
    ) -> NDArray[np.float64]:
        """(K, 4) what was shut that reaches into the box from `low` to `high` (2,) on the storey of a camera at z."""
        shut = self._shut[since:]
        x, y, at_z, radius = shut.T
        across = (x > low[0] - radius) & (x < high[0] + radius)
        along = (y > low[1] - radius) & (y < high[1] + radius)
        return shut[across & along & (np.abs(at_z - z) < _STOREY)]

    def is_wide(self, places: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) whether the robot has room at places (N, 3)."""
        return self.clearance(places) >= self.least


class _Window:
    """The cells within `reach` of a camera (3,) that have room. places (nodes, 3); `start` is the camera's node."""

    def __init__(self, camera: NDArray[np.floating], reach: float, floor: KnownRoom) -> None:
        half = int(np.ceil(reach / _CELL))
        self._side, self._camera = 2 * half + 1, np.asarray(camera, np.float64)
        self._low = self._camera[:2] - (half + 0.5) * _CELL
        along = (np.arange(self._side) + 0.5) * _CELL
        x, y, z = self._low[0] + along, self._low[1] + along, float(self._camera[2])
        self._clearance = floor.clearance_over(x, y, z)
        room = self._clearance >= floor.least
        room[half, half] = True
        self._node = np.full(room.shape, -1, np.int64)
        self._node[room] = np.arange(int(room.sum()))
        row, column = np.nonzero(room)
        self.places = np.column_stack([x[column], y[row], np.full(len(row), z)])
        self.start = int(self._node[half, half])

    def nodes_at(self, places: NDArray[np.floating]) -> NDArray[np.int64]:
        """(N,) nodes of places (N, 3) on the camera's storey, -1 where there is none."""
        index = np.floor((places[:, :2] - self._low) / _CELL).astype(np.int64)
        inside = ((index >= 0) & (index < self._side)).all(axis=1)
        inside &= np.abs(places[:, 2] - self._camera[2]) < _STOREY
        found = np.full(len(places), -1, np.int64)
        found[inside] = self._node[index[inside, 1], index[inside, 0]]
        return found

    def steps(self, tight: float) -> Any:
        """The steps between nodes as a sparse matrix of metres, longer by up to `tight` times where room is scarce."""
        dearer = 1 + tight * np.clip(1 - self._clearance / _EASY, 0, 1) if tight else None
        return steps_between(self._node >= 0, self._node, _CELL, dearer)
