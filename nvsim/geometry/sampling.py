"""Evenly spread samples: of indices, and of positions along a trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def evenly_spaced(count: int, most: int) -> list[int]:
    """At most `most` of the numbers from 0 to `count` - 1, ascending, including the first and the last. Empty if
    `count` is 0."""
    if count == 0:
        return []
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(count, most)).round())]


STRIDE = 1.0
"""Meters between two cameras, beyond which the path between them is unknown."""


def places_between(positions: NDArray[np.floating], apart: float, longest: float) -> NDArray[np.float64]:
    """(M, D) float64 points on the straight lines between consecutive `positions` (N, D), including the positions, in
    order.

    Neighboring points are at most `apart` meters from each other. If two positions are farther than `longest` meters
    apart, the path between them is unknown, and no points are added between them."""
    walk = np.asarray(positions, np.float64)
    way = np.diff(walk, axis=0)
    length = np.linalg.norm(way, axis=1)
    count = np.where(length > longest, 1, np.maximum(1, np.ceil(length / apart))).astype(np.int64)
    leg = np.repeat(np.arange(len(way)), count)
    share = (np.arange(len(leg)) - (np.cumsum(count) - count)[leg]) / count[leg]
    return np.concatenate([walk[leg] + share[:, None] * way[leg], walk[-1:]])
