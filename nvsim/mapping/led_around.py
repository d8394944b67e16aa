"""Where the trajectory leads a long way around: without a scan a pane of glass is not seen, and the corridor across it
looks free; but nobody walked through it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from nvsim.mapping.walk import Walk

_LINKED = 0.8  # metres between places of the trajectory that somebody might have gone between
_ASIDE = 0.4  # metres farther than the nearest place that another may be for a viewpoint to belong to it as well
_NEAREST = 60  # places that are looked at
_LONGER = 4.0  # metres longer, in any case, the way along the trajectory must be
_FAR = 30.0  # metres along the trajectory from which on it does not matter how far it is
_BODY = 0.45  # metres from the trajectory within which no pane stands: somebody walked there
_BETWEEN = 2.5  # metres from a place to the parts of the trajectory that it may lie between, at most
_SPACING = 0.2  # metres between the places of an edge that are looked at

Camera = tuple[float, ...]


class LedAround:
    """Compares straight ways with those along `walk`: one is led around where the latter is `times` as long. A pane may
    stand anywhere between two parts of the walk that are led around, so what lies between them away from both counts as
    led around as well."""

    def __init__(self, walk: Walk, times: float = 3.0) -> None:
        from scipy.sparse import coo_matrix
        from scipy.spatial import cKDTree

        self._walk, self._times = walk, times
        places, self._tree = walk.places, cKDTree(walk.places[:, :2])
        after = np.flatnonzero(walk.joined)
        near = self._tree.query_pairs(_LINKED, output_type="ndarray")
        near = near[walk.all_in_line(places[near[:, 0]], places[near[:, 1]])]
        pairs = np.concatenate([np.column_stack([after, after + 1]), near])
        # The same pair twice would count as the sum of both.
        pairs = np.unique(pairs, axis=0)
        metres = np.hypot(*(places[pairs[:, 0], :2] - places[pairs[:, 1], :2]).T)
        self._steps = coo_matrix((np.maximum(metres, 1e-6), pairs.T), shape=(len(places),) * 2).tocsr()
        self._from: dict[int, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}
        self._beside: dict[Camera, tuple[NDArray[np.int64], NDArray[np.float64]]] = {}

    def __call__(self, a: Camera, b: Camera) -> float:
        """Metres along the trajectory between two cameras (x, y, z), or between what the way from one to the other lies
        between, where that is a long way around; else 0. Infinite where it does not lead from one to the other, 0 where
        one of them sees none of it."""
        ends = np.array([a, b], np.float64)
        straight = float(np.hypot(*(ends[0] - ends[1])[:2]))
        (here, off), (there, beyond) = self._belongs(a), self._belongs(b)
        if not len(here) or not len(there):
            return 0.0
        along = min(float((off[i] + self._metres(int(k), there) + beyond).min()) for i, k in enumerate(here))
        if along > max(self._times * straight, straight + _LONGER):
            return along
        count = max(2, int(np.ceil(straight / _SPACING)) + 1)
        return self._between(ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0]))

    def _between(self, places: NDArray[np.float64]) -> float:
        """The most metres along the trajectory between two parts of it, the nearest in line with one of the places
        (M, 3) and another, where that is a long way around and the place is near to neither; else 0."""
        metres, index = self._tree.query(places[:, :2], k=_NEAREST, distance_upper_bound=_BETWEEN)
        of, which = np.nonzero(np.isfinite(metres))
        index, metres = index[of, which], metres[of, which]
        seen = self._walk.all_in_line(places[of], self._walk.places[index])
        of, index, metres = of[seen], index[seen], metres[seen]
        most = 0.0
        for start, end in pairwise([*np.flatnonzero(np.diff(of, prepend=-1)).tolist(), len(of)]):
            if metres[start] <= _BODY:
                continue
            along = self._metres(int(index[start]), index[start:end])
            straight = metres[start:end] + metres[start]
            around = along[along > np.maximum(self._times * straight, straight + _LONGER)]
            most = max(most, float(around.min(initial=np.inf)) if len(around) else 0.0)
        return most

    def _belongs(self, camera: Camera) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The places (n,) in line with a camera (x, y, z) that are nearest to it, and how far they are, metres."""
        if camera not in self._beside:
            place = np.asarray(camera, np.float64)
            metres, index = self._tree.query(place[:2], k=min(_NEAREST, len(self._walk.places)))
            metres, index = np.atleast_1d(metres), np.atleast_1d(index)
            in_line = self._walk.all_in_line(np.broadcast_to(place, (len(index), 3)), self._walk.places[index])
            metres, index = metres[in_line], index[in_line]
            near = metres <= metres.min(initial=np.inf) + _ASIDE
            self._beside[camera] = index[near].astype(np.int64), metres[near]
        return self._beside[camera]

    def _metres(self, place: int, others: NDArray[np.int64]) -> NDArray[np.float64]:
        """(n,) along the trajectory from one of its places to others (n,); infinite from _FAR on."""
        from scipy.sparse.csgraph import dijkstra

        if place not in self._from:
            metres = dijkstra(self._steps, directed=False, indices=place, limit=_FAR)
            near = np.flatnonzero(np.isfinite(metres))
            self._from[place] = near, metres[near]
        near, metres = self._from[place]
        at = np.minimum(np.searchsorted(near, others), len(near) - 1)
        return np.where(near[at] == others, metres[at], np.inf)
