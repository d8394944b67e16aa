"""The trajectory of the capture, as the builder uses it: heights, distances, and positions for starts; and the progress
of a build along it."""

from __future__ import annotations

from collections.abc import Callable, Set

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.cells import grid_size
from nvsim.mapping.corridor import SupportAt
from nvsim.mapping.evidence.traversed_floor import JUMP
from nvsim.mapping.search.graph_builder import GraphBuilder
from nvsim.submaps.split import storeys_of

_SPACING = 0.4  # meters between the positions that are used
_CELL = 0.1  # meters, of the grid on which clearance is measured
_REACH = 3.0  # meters, the maximum clearance
_LOOKED = 0.05  # meters between the examined positions of a line
_UPRIGHT = 3.0  # weight of a vertical meter relative to a horizontal one, in stacked storeys


class Walk:
    """The trajectory of a capture.

    places     (M, 3) camera positions, thinned along the trajectory, meters, world
    clearance  (M,) meters to the nearest unknown floor, at most 3
    joined     (M - 1,) bool, whether a position and the next belong to one continuous trajectory
    """

    def __init__(self, positions: NDArray[np.floating], support: SupportAt) -> None:
        from scipy.spatial import cKDTree

        self._positions = np.asarray(positions, np.float64).reshape(-1, 3)
        self._support = support
        self._tree = cKDTree(self._positions[:, :2])
        self._storeys = storeys_of(self._positions)
        self._upright = cKDTree(self._positions * [1, 1, _UPRIGHT]) if len(self._storeys.levels) > 1 else None
        kept, broken = [0], []
        jump = False
        for i in range(1, len(self._positions)):
            jump = jump or _distance(self._positions[i], self._positions[i - 1]) > JUMP
            if _distance(self._positions[i], self._positions[kept[-1]]) >= _SPACING:
                kept.append(i)
                broken.append(jump)
                jump = False
        self.places = self._positions[kept]
        self.joined = ~np.array(broken, bool)
        self._low = self.places[:, :2].min(axis=0) - _REACH
        self._free = [self._clearances(float(level)) for level in self._storeys.levels]
        self.clearance = self.clearance_at(self.places)

    @property
    def is_stacked(self) -> bool:
        """Whether storeys are stacked."""
        return len(self._storeys.levels) > 1

    def storey(self, z: float) -> int:
        """Return the storey of a camera at world z, from 0 for the lowest."""
        return int(self._storeys.nearest(z))

    def distance(self, place: NDArray[np.floating]) -> float:
        """Return the meters, seen from above, from a position (2,) or (3,) to the nearest camera. z selects the
        storey."""
        return float(self._nearest(place)[0])

    def height(self, place: NDArray[np.floating]) -> float:
        """Return world z of the camera that is nearest to a position (2,) or (3,). z selects the storey (paper, section
        III-D)."""
        return float(self._positions[int(self._nearest(place)[1]), 2])

    def _nearest(self, places: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """(...) meters, seen from above, from positions (..., 2) or (..., 3) to the nearest camera, and its index."""
        places = np.asarray(places)
        if self._upright is None or places.shape[-1] < 3:
            distance, nearest = self._tree.query(places[..., :2])
            return distance, nearest
        nearest = self._upright.query(places * [1, 1, _UPRIGHT])[1]
        return np.linalg.norm(self._positions[nearest, :2] - places[..., :2], axis=-1), nearest

    def is_line_known(self, a: NDArray[np.floating], b: NDArray[np.floating]) -> bool:
        """Whether all floor is known on the straight line between two positions (2,) or cameras (3,)."""
        return bool(self.are_lines_known(np.asarray(a)[None], np.asarray(b)[None])[0])

    def are_lines_known(self, a: NDArray[np.floating], b: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Return (N,) bool: `is_line_known` for each pair of positions (N, 2) or cameras (N, 3). Testing many pairs
        together is fast."""
        if len(a) == 0:
            return np.zeros(0, bool)
        way = b - a
        count = np.maximum(2, np.ceil(np.hypot(way[:, 0], way[:, 1]) / _LOOKED).astype(np.int64) + 1)
        first = np.cumsum(count) - count
        line = np.repeat(np.arange(len(a)), count)
        share = (np.arange(len(line)) - first[line]) * (1.0 / (count - 1))[line]
        share[first + count - 1] = 1.0
        known = np.asarray(self._support(a[line] + share[:, None] * way[line]), bool)
        return np.asarray(np.logical_and.reduceat(known, first))

    def positions_beside(self, clearance: float, spacing: float) -> NDArray[np.float64]:
        """Return (K, 3) positions, meters, on known floor within 3 m of a camera, at the height of that camera. Each is
        the position with the most clearance in a square `spacing` meters wide, and has at least `clearance` meters.
        Those with the most clearance come first, storey by storey."""
        return np.concatenate(
            [self._positions_beside_on_storey(storey, clearance, spacing) for storey in range(len(self._free))]
        )

    def _positions_beside_on_storey(self, storey: int, clearance: float, spacing: float) -> NDArray[np.float64]:
        row, column = np.nonzero(self._free[storey] >= clearance)
        xy = self._low + (np.stack([column, row], axis=1) + 0.5) * _CELL
        distance, nearest = self._nearest(np.column_stack([xy, np.full(len(xy), self._storeys.levels[storey])]))
        free = np.round(self._free[storey][row, column], 6)
        order = np.lexsort((column, row, -free))
        order = order[distance[order] < _REACH]
        square = np.floor(xy[order] / spacing).astype(np.int64)
        order = order[np.sort(np.unique(square, axis=0, return_index=True)[1])]
        return np.column_stack([xy[order], self._positions[nearest[order], 2]])

    def clearance_at(self, places: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return (N,) meters from positions (N, 2) or (N, 3) to the nearest unknown floor, at most 3; z selects the
        storey. 0 far from the cameras."""
        places = np.asarray(places, np.float64)
        on = self._storeys.nearest(places[:, 2]) if places.shape[1] > 2 else np.zeros(len(places), np.int64)
        index = np.floor((places[:, :2] - self._low) / _CELL).astype(np.int64)[:, ::-1]
        inside = ((index >= 0) & (index < self._free[0].shape)).all(axis=1)
        found = np.zeros(len(index))
        for storey, free in enumerate(self._free):
            here = inside & (on == storey)
            found[here] = free[index[here, 0], index[here, 1]]
        return np.minimum(found, _REACH)

    def clearance_over(self, x: NDArray[np.floating], y: NDArray[np.floating], z: float) -> NDArray[np.float64]:
        """Return (rows, columns) clearances in meters for all positions with a coordinate of `y` (rows,) and of `x`
        (columns,), meters, world. z selects the storey."""
        free = self._free[self.storey(z)]
        column = np.floor((x - self._low[0]) / _CELL).astype(np.int64)
        row = np.floor((y - self._low[1]) / _CELL).astype(np.int64)
        columns, rows = ((at >= 0) & (at < size) for at, size in ((column, free.shape[1]), (row, free.shape[0])))
        found = np.zeros((len(y), len(x)))
        found[np.ix_(rows, columns)] = free[np.ix_(row[rows], column[columns])]
        return np.minimum(found, _REACH)

    def _clearances(self, level: float) -> NDArray[np.float64]:
        """(rows, columns) meters from the cells around the positions to the nearest unknown floor, on the storey of
        cameras at the height `level`."""
        from scipy.ndimage import distance_transform_edt

        high = self.places[:, :2].max(axis=0) + _REACH
        columns, rows = grid_size(self._low, high, _CELL, "the cameras")
        x = self._low[0] + (np.arange(columns) + 0.5) * _CELL
        y = self._low[1] + (np.arange(rows) + 0.5) * _CELL
        points = np.stack([*np.meshgrid(x, y), np.full((rows, columns), level)], axis=-1)
        known = np.pad(np.asarray(self._support(points), bool), 1)
        return np.asarray(distance_transform_edt(known)[1:-1, 1:-1] * _CELL)


def _distance(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(a - b))


class CoveredPositions:
    """The positions of the trajectory that are done. A position is done if it is covered and a viewpoint near it was
    expanded. It is also done if a search that began there found no room. Positions stay done."""

    def __init__(
        self,
        places: NDArray[np.float64],  # (N, 3) meters
        draft: GraphBuilder,
        reach: float,  # maximum meters at which a viewpoint covers a position
        is_covered: Callable[[NDArray[np.float64]], bool],
    ) -> None:
        self._places, self._draft, self._reach, self._is_covered = places, draft, reach, is_covered
        self._left = np.arange(len(places))
        self._asked: set[str] = set()

    @property
    def count_left(self) -> int:
        """Number of positions that are not done."""
        return len(self._left)

    def give_up(self, place: int) -> None:
        """Count a position as done at which no search could begin."""
        self._left = self._left[self._left != place]

    def update(self, expanded: Set[str]) -> None:
        """Count the positions that the viewpoints `expanded` cover. Every viewpoint is examined once."""
        for id in expanded - self._asked:
            viewpoint = self._draft.viewpoints.get(id)
            if viewpoint is None or not len(self._left):
                continue
            away = np.linalg.norm(self._places[self._left, :2] - viewpoint.position[:2], axis=1)
            near = self._left[away <= self._reach]
            gone = [i for i in near.tolist() if self._is_covered(self._places[i])]
            self._left = self._left[~np.isin(self._left, gone)]
        self._asked |= expanded
