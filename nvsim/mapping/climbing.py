"""What speaks for floor besides a view of it, for that of a stair above all: a view from below shows the last steps
edge-on, and few cameras see a stair at all, but somebody carried one over it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.carried import places_between
from nvsim.geometry.cells import grid_size
from nvsim.mapping.floor_pixels import Eye

CLIMB = 0.3  # metres: a corridor whose floor differs by more from where it begins climbs, maybe to another storey
_GRAZING = 0.15  # metres of height over the floor for each metre to it; less shows a slope edge-on
_BODY = 0.4  # metres to either side of a carried camera that were free when it passed
_CARRIED = 0.3, 2.5  # metres over the floor, at least and at most
_BETWEEN = 0.1  # metres between the places of a trajectory that are looked at
JUMP = 1.5  # metres between cameras beyond which nobody walked straight from one to the next


class Trodden:
    """Knows where somebody carried the camera."""

    def __init__(self, positions: NDArray[np.floating], scanned: bool = True) -> None:
        """Of a trajectory with camera `positions` (N, 3), metres, z up, in the order in which they were taken. Where
        nothing was `scanned`, models of images alone have something in the air where nothing is, in doors for example:
        the trajectory tells that it is not there."""
        from scipy.spatial import cKDTree

        self._tells = not scanned
        self._places = places_between(np.reshape(positions, (-1, 3)), _BETWEEN, JUMP)
        self._tree = cKDTree(self._places[:, :2])
        self._squares = _Squares(self._places) if self._tells else None

    def at(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(...) whether somebody walked over places of the floor (..., 3), metres, or right beside them."""
        flat = np.asarray(points, np.float64).reshape(-1, 3)
        found = np.zeros(len(flat), bool)
        for i, near in enumerate(self._tree.query_ball_point(flat[:, :2], _BODY)):
            over = self._places[near, 2] - flat[i, 2]
            found[i] = bool(((over > _CARRIED[0]) & (over < _CARRIED[1])).any())
        return found.reshape(points.shape[:-1])

    def surely_at(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(...) the same by the nearest camera, off stairs too, where images alone tell what stands; else all False."""
        if self._squares is None:
            return np.zeros(points.shape[:-1], bool)
        return self._squares.beneath(points)


class _Squares:
    """The places (P, 3) of a carried camera in squares, so that the nearest to a point lies in one of nine; a tree
    takes six times as long for the few hundred points of a corridor."""

    def __init__(self, places: NDArray[np.float64]) -> None:
        low = places[:, :2].min(axis=0)
        columns, rows = (n + 1 for n in grid_size(low, places[:, :2].max(axis=0), _BODY, "the cameras"))
        column, row = np.floor((places[:, :2] - low) / _BODY).astype(np.int64).T
        order = np.argsort(row * columns + column, kind="stable")
        self._places, self._low, self._columns = np.ascontiguousarray(places[order]), low, columns
        self._first = np.searchsorted((row * columns + column)[order], np.arange(columns * rows + 1))

    def beneath(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(...) whether the nearest camera within a body's width of places of the floor (..., 3) is over them."""
        from nvsim.mapping import floor_kernels

        flat = np.ascontiguousarray(np.reshape(points, (-1, 3)), np.float64)
        found, low = np.empty(len(flat), bool), (float(self._low[0]), float(self._low[1]))
        floor_kernels.trodden(
            flat, self._places, self._first, low, _BODY, self._columns, _BODY, *_CARRIED, found
        )  # fmt: skip
        return found.reshape(np.shape(points)[:-1])


def out_of_sight(eye: Eye, ground: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(rows, cells) which of the floor cells (rows, cells, 3) lie so much higher than the first that they are seen from
    beneath or at a grazing angle."""
    climb = ground[..., 2] - np.median(ground[0, :, 2])
    distance = np.hypot(*np.moveaxis(ground[..., :2] - eye.position[:2], -1, 0))
    return np.asarray((climb > CLIMB) & (eye.position[2] - ground[..., 2] < _GRAZING * distance))
