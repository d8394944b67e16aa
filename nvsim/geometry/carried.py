"""The places between cameras that were carried from one to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

STRIDE = 1.0
"""Metres between two cameras, beyond which nobody knows what a person passed on the way from one to the other."""


def places_between(positions: NDArray[np.floating], apart: float, longest: float) -> NDArray[np.float64]:
    """(M, D) places on the straight ways from each of positions (N, D) to the next, at most `apart` metres from one
    another, the positions themselves among them and in their order. Between positions that are farther than `longest`
    from one another nobody knows how the camera got there: only both count."""
    walk = np.asarray(positions, np.float64)
    way = np.diff(walk, axis=0)
    length = np.linalg.norm(way, axis=1)
    count = np.where(length > longest, 1, np.maximum(1, np.ceil(length / apart))).astype(np.int64)
    leg = np.repeat(np.arange(len(way)), count)
    share = (np.arange(len(leg)) - (np.cumsum(count) - count)[leg]) / count[leg]
    return np.concatenate([walk[leg] + share[:, None] * way[leg], walk[-1:]])
