"""Evidence of free floor other than a view of it, mainly for stairs. A view from below shows the last steps edge-on,
and few cameras see stairs at all, but the camera was carried over them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.cells import grid_size
from nvsim.geometry.sampling import places_between
from nvsim.mapping.views.floor_pixels import Eye

CLIMB = 0.3  # meters: a corridor climbs if its floor differs by more from its beginning, perhaps to another storey
_GRAZING = 0.15  # meters above the floor per meter of distance; with less, a slope is seen edge-on
_BODY = 0.4  # meters on either side of a carried camera that were free when it passed
_CARRIED = 0.3, 2.5  # minimum and maximum meters of a carried camera above the floor
_BETWEEN = 0.1  # meters between the sampled positions of a trajectory
JUMP = 1.5  # meters between cameras; beyond it, the camera was not carried straight from one to the next


class TraversedFloor:
    """The floor over which the camera was carried."""

    def __init__(self, positions: NDArray[np.floating], scanned: bool = True) -> None:
        """`positions` (N, 3): camera positions in the order of the capture, meters, z up. `scanned`: whether there is a
        LiDAR scan. Models from images alone show obstacles in free space, for example in doors. Without a LiDAR scan,
        the trajectory therefore proves that such space is free."""
        from scipy.spatial import cKDTree

        self._tells = not scanned
        self._places = places_between(np.reshape(positions, (-1, 3)), _BETWEEN, JUMP)
        self._tree = cKDTree(self._places[:, :2])
        self._squares = _PositionGrid(self._places) if self._tells else None

    def is_traversed(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return (...) bool: whether the camera was carried over floor points (..., 3), meters, or right beside
        them."""
        flat = np.asarray(points, np.float64).reshape(-1, 3)
        found = np.zeros(len(flat), bool)
        for i, near in enumerate(self._tree.query_ball_point(flat[:, :2], _BODY)):
            over = self._places[near, 2] - flat[i, 2]
            found[i] = bool(((over > _CARRIED[0]) & (over < _CARRIED[1])).any())
        return found.reshape(points.shape[:-1])

    def is_surely_traversed(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return (...) bool for floor points (..., 3), meters: as `is_traversed`, but by the nearest camera only, and
        also away from stairs. All False if there is a LiDAR scan."""
        if self._squares is None:
            return np.zeros(points.shape[:-1], bool)
        return self._squares.is_under_camera(points)


class _PositionGrid:
    """The positions (P, 3) of a carried camera in squares, so that a search reads nine of them. A tree takes six times
    as long for the few hundred points of a corridor."""

    def __init__(self, places: NDArray[np.float64]) -> None:
        low = places[:, :2].min(axis=0)
        columns, rows = (n + 1 for n in grid_size(low, places[:, :2].max(axis=0), _BODY, "the cameras"))
        column, row = np.floor((places[:, :2] - low) / _BODY).astype(np.int64).T
        order = np.argsort(row * columns + column, kind="stable")
        self._places, self._low, self._columns = np.ascontiguousarray(places[order]), low, columns
        self._first = np.searchsorted((row * columns + column)[order], np.arange(columns * rows + 1))

    def is_under_camera(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return (...) bool: whether the nearest camera within a body's width of floor points (..., 3) is over them."""
        from nvsim.mapping import floor_kernels

        flat = np.ascontiguousarray(np.reshape(points, (-1, 3)), np.float64)
        found, low = np.empty(len(flat), bool), (float(self._low[0]), float(self._low[1]))
        floor_kernels.mark_traversed(
            flat, self._places, self._first, low, _BODY, self._columns, _BODY, *_CARRIED, found
        )  # fmt: skip
        return found.reshape(np.shape(points)[:-1])


def out_of_sight(eye: Eye, ground: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (rows, cells) bool: which floor cells (rows, cells, 3), meters, are so much higher than the first row that
    they are seen from below or at a grazing angle."""
    climb = ground[..., 2] - np.median(ground[0, :, 2])
    distance = np.hypot(*np.moveaxis(ground[..., :2] - eye.position[:2], -1, 0))
    return np.asarray((climb > CLIMB) & (eye.position[2] - ground[..., 2] < _GRAZING * distance))
