"""A submap: a cluster of frames that becomes one trained model, and its overlap with neighboring submaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Submap:
    """index    position in the list, also its name on disk
    core      frame indices of the cluster, ascending; every frame is in exactly one core
    frames    core and the frames within the overlap distance of it, ascending
    positions (len(core), 3) float64 camera positions of the core, meters, world; they define "the closest submap"
    """

    index: int
    core: tuple[int, ...]
    frames: tuple[int, ...]
    positions: NDArray[np.float64]


def nearest_submap(submaps: tuple[Submap, ...] | list[Submap], position: NDArray[np.floating]) -> int:
    """Index of the submap with the core camera nearest to `position` (3,), meters (paper Algorithm 1, line 4)."""
    distances = [float(np.min(np.sum((s.positions - position) ** 2, axis=1))) for s in submaps]
    return submaps[int(np.argmin(distances))].index
