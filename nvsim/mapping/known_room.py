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
        """Whether anything was shut within a window of `reach` metres around a place (3,), when `shuts` was `before` or
        later."""
        x, y, z, radius = self._shut[max(0, before) :].T
        far = np.maximum(np.abs(x - place[0]), np.abs(y - place[1])) - radius
        return bool(((far <= reach + _CELL) & (np.abs(z - place[2]) < _STOREY)).any())

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
        if len(places) and len(self._shut):
            x, y, z, radius = self._shut.T
            low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
            near = (x > low[0] - radius) & (x < high[0] + radius) & (y > low[1] - radius) & (y < high[1] + radius)
            for shut in self._shut[near & (np.abs(places[0, 2] - z) < _STOREY)]:
                found[np.hypot(places[:, 0] - shut[0], places[:, 1] - shut[1]) < shut[3]] = 0.0
        return found

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
        x, y = np.meshgrid(self._low[0] + along, self._low[1] + along)
        places = np.stack([x, y, np.full_like(x, self._camera[2])], axis=-1)
        self._clearance = floor.clearance(places.reshape(-1, 3)).reshape(x.shape)
        room = self._clearance >= floor.least
        room[half, half] = True
        self._node = np.full(room.shape, -1, np.int64)
        self._node[room] = np.arange(int(room.sum()))
        self.places, self.start = places[room], int(self._node[half, half])

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
