"""Find edges around which the trajectory makes a long detour. Without a LiDAR scan, glass panes are not visible and the
corridor through one looks free, but the camera was never carried through it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from nvsim.mapping.search.trajectory import Walk

_LINKED = 0.8  # maximum meters between positions of the trajectory between which the camera could have been carried
_ASIDE = 0.4  # meters: a viewpoint also belongs to positions that are this much farther than the nearest
_NEAREST = 60  # maximum positions that are examined
_LONGER = 4.0  # minimum meters by which the path along the trajectory must be longer
_FAR = 30.0  # meters along the trajectory; longer distances count as infinite
_BODY = 0.45  # meters from the trajectory within which there is no glass, because the camera was carried there
_BETWEEN = 2.5  # maximum meters from a position to the parts of the trajectory on both sides of it
_SPACING = 0.2  # meters between the examined positions of an edge

Camera = tuple[float, ...]


class TrajectoryDetour:
    """Compares straight lines with paths along the trajectory `walk`. The trajectory makes a detour if its path is more
    than `times` as long as the line. A glass pane can be anywhere between two parts of the trajectory with a detour
    between them. Positions between two such parts, away from both, therefore count as well."""

    def __init__(self, walk: Walk, times: float = 3.0) -> None:
        from scipy.sparse import coo_matrix
        from scipy.spatial import cKDTree

        self._walk, self._times = walk, times
        places, self._tree = walk.places, cKDTree(walk.places[:, :2])
        after = np.flatnonzero(walk.joined)
        near = self._tree.query_pairs(_LINKED, output_type="ndarray")
        near = near[walk.are_lines_known(places[near[:, 0]], places[near[:, 1]])]
        pairs = np.concatenate([np.column_stack([after, after + 1]), near])
        # Duplicate pairs would be added up.
        pairs = np.unique(pairs, axis=0)
        meters = np.hypot(*(places[pairs[:, 0], :2] - places[pairs[:, 1], :2]).T)
        self._steps = coo_matrix((np.maximum(meters, 1e-6), pairs.T), shape=(len(places),) * 2).tocsr()
        self._from: dict[int, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}
        self._beside: dict[Camera, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}

    def __call__(self, a: Camera, b: Camera) -> float:
        """Return the meters along the trajectory between two cameras (x, y, z), or between the parts of the trajectory
        on both sides of the line, if that is a long detour; else 0. Infinite if the trajectory does not connect the
        two. 0 if one of them sees no position of the trajectory."""
        ends = np.array([a, b], np.float64)
        straight = float(np.hypot(*(ends[0] - ends[1])[:2]))
        (here, off), (there, beyond) = self._belongs(a), self._belongs(b)
        if not len(here) or not len(there):
            return 0.0
        along = min(float((off[i] + self._meters(int(k), there) + beyond).min()) for i, k in enumerate(here))
        if along > max(self._times * straight, straight + _LONGER):
            return along
        count = max(2, int(np.ceil(straight / _SPACING)) + 1)
        return self._longest_detour(ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0]))

    def _longest_detour(self, places: NDArray[np.float64]) -> float:
        """Return the longest detour in meters along the trajectory between two parts of it on both sides of one of the
        positions (M, 3); 0 if there is none. One part is the nearest in line with the position. Positions near the
        trajectory are skipped."""
        meters, index = self._tree.query(places[:, :2], k=_NEAREST, distance_upper_bound=_BETWEEN)
        of, which = np.nonzero(np.isfinite(meters))
        index, meters = index[of, which], meters[of, which]
        seen = self._walk.are_lines_known(places[of], self._walk.places[index])
        of, index, meters = of[seen], index[seen], meters[seen]
        most = 0.0
        for start, end in pairwise([*np.flatnonzero(np.diff(of, prepend=-1)).tolist(), len(of)]):
            if meters[start] <= _BODY:
                continue
            along = self._meters(int(index[start]), index[start:end])
            straight = meters[start:end] + meters[start]
            around = along[along > np.maximum(self._times * straight, straight + _LONGER)]
            most = max(most, float(around.min(initial=np.inf)) if len(around) else 0.0)
        return most

    def _belongs(self, camera: Camera) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The (n,) positions of the trajectory that are nearest to a camera (x, y, z) and in line with it, and their
        (n,) distances in meters."""
        if camera not in self._beside:
            place = np.asarray(camera, np.float64)
            meters, index = self._tree.query(place[:2], k=min(_NEAREST, len(self._walk.places)))
            meters, index = np.atleast_1d(meters), np.atleast_1d(index)
            in_line = self._walk.are_lines_known(np.broadcast_to(place, (len(index), 3)), self._walk.places[index])
            meters, index = meters[in_line], index[in_line]
            near = meters <= meters.min(initial=np.inf) + _ASIDE
            self._beside[camera] = index[near].astype(np.int64), meters[near]
        return self._beside[camera]

    def _meters(self, place: int, others: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n,) meters along the trajectory from one of its positions to others (n,); infinite beyond _FAR."""
        from scipy.sparse.csgraph import dijkstra

        if place not in self._from:
            meters = dijkstra(self._steps, directed=False, indices=place, limit=_FAR)
            near = np.flatnonzero(np.isfinite(meters))
            self._from[place] = near, meters[near]
        near, meters = self._from[place]
        at = np.minimum(np.searchsorted(near, others), len(near) - 1)
        return np.where(near[at] == others, meters[at], np.inf)
