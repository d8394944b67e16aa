"""Tracks: points that several images show, from chains of matched features."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.poses.features import Features


@dataclass(frozen=True, eq=False)
class Tracks:
    """Observations of points in images, N in total.

    point   (N,) int64, index of the point, from 0
    frame   (N,) int64, index of the image
    places  (N, 2) float64, pixels of that image
    """

    point: NDArray[np.int64]
    frame: NDArray[np.int64]
    places: NDArray[np.float64]

    @property
    def points(self) -> int:
        """Number of points."""
        return int(self.point.max()) + 1 if len(self.point) else 0


def tracks_of(
    features: Sequence[Features], pairs: Sequence[tuple[int, int]], matches: Sequence[NDArray[np.int64]]
) -> Tracks:
    """Tracks from the matches (M, 2) of the features of each pair of frames: the connected components of features.
    Components with two features in one image are wrong and removed."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    counts = np.array([len(f) for f in features], np.int64)
    first = np.concatenate([[0], np.cumsum(counts)])
    ends = [(first[i] + m[:, 0], first[j] + m[:, 1]) for (i, j), m in zip(pairs, matches, strict=True) if len(m)]
    if not ends:
        return Tracks(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)))
    a, b = (np.concatenate(side) for side in zip(*ends, strict=True))
    links = coo_matrix((np.ones(len(a), np.int8), (a, b)), shape=(first[-1], first[-1]))
    _, belongs = connected_components(links, directed=False)
    rows = np.flatnonzero(np.bincount(belongs)[belongs] > 1)
    frame = np.repeat(np.arange(len(counts)), counts)[rows]
    seen, times = np.unique(belongs[rows].astype(np.int64) * len(counts) + frame, return_counts=True)
    wrong = np.unique(seen[times > 1] // len(counts))
    right = ~np.isin(belongs[rows], wrong)
    rows, frame = rows[right], frame[right]
    places = np.concatenate([f.places for f in features])[rows]
    return Tracks(np.unique(belongs[rows], return_inverse=True)[1].astype(np.int64), frame, places)
