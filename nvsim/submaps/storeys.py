"""The storeys of a trajectory: the cameras on each storey, and on the stairs between storeys.

Storeys are separated only if they are stacked. A hill, a ramp, or a split level has one floor at every place, and
counts as one storey here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.storeys import FEW, storeys

_LEVEL = 0.3  # meters by which cameras on a storey differ from its level
_MOST = 0.7  # least share of such cameras; otherwise the trajectory has one storey
_OVER = 3.0  # meters, seen from above, between cameras of stacked storeys


@dataclass(frozen=True, eq=False)
class TrajectoryStoreys:
    """levels  (S,) meters, world z: height of most cameras on each storey, ascending; (1,) for one storey
    part    (N,) for each camera: 2 k on storey k, 2 k + 1 on a stair from storey k to storey k + 1
    """

    levels: NDArray[np.float64]
    part: NDArray[np.int64]

    def on(self, storey: int) -> NDArray[np.bool_]:
        """(N,) bool, True for cameras on a storey and on the stairs that lead to it."""
        return np.asarray(np.abs(self.part - 2 * storey) <= 1)

    def nearest(self, heights: NDArray[np.floating] | float) -> NDArray[np.int64]:
        """(...,) int64 index of the storey with the nearest camera level for `heights` (...,), meters, world z."""
        return np.asarray(np.abs(np.asarray(heights)[..., None] - self.levels).argmin(axis=-1), np.int64)


def storeys_of(positions: NDArray[np.floating]) -> TrajectoryStoreys:
    """The storeys of camera `positions` (N, 3), meters."""
    points = np.asarray(positions, np.float64).reshape(-1, 3)
    z = points[:, 2]
    one = TrajectoryStoreys(np.array([np.median(z) if len(z) else 0.0]), np.zeros(len(z), np.int64))
    levels = np.array([s.floor for s in storeys(z)])
    if len(levels) < 2:
        return one
    found = TrajectoryStoreys(levels, np.zeros(len(z), np.int64))
    nearest = found.nearest(z)
    off = z - levels[nearest]
    level = np.abs(off) <= _LEVEL
    if level.mean() < _MOST or not _is_stacked([points[level & (nearest == k), :2] for k in range(len(levels))]):
        return one
    part = 2 * nearest
    part += np.where((off > _LEVEL) & (nearest + 1 < len(levels)), 1, 0)
    part -= np.where((off < -_LEVEL) & (nearest > 0), 1, 0)
    counts = np.bincount(part, minlength=2 * len(levels))
    few = (part % 2 == 1) & (counts[part] < FEW)
    return TrajectoryStoreys(levels, np.where(few, 2 * nearest, part))


def _is_stacked(storeys: list[NDArray[np.float64]]) -> bool:
    """Whether cameras of any two of `storeys`, each (M, 2), are close to each other seen from above."""
    from scipy.spatial import cKDTree

    trees = [cKDTree(places) for places in storeys if len(places)]
    return any(a.count_neighbors(b, _OVER) > 0 for i, a in enumerate(trees) for b in trees[i + 1 :])
