"""Which places lie behind walls for an eye, by the occupancy map: plain arrays, no widgets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.occupancy.types import OCCUPIED, OccupancyMap

WALL = 2.2  # metres above the floor; the map does not say how high a thing is
_ABOVE = 3.0  # metres over the floor from which an eye looks over the building, not out of a room
_STEP = 0.1  # metres between two looks along a ray
_MOST = 250  # looks along a ray; a longer one is looked at more coarsely
_NEAR = 0.3  # metres before the place that count for nothing: it stands beside a wall, not behind it


def behind_walls(occupancy: OccupancyMap, eye: NDArray[np.floating], feet: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(N,) whether the straight way from `eye` (3,) to each of `feet` (N, 3), places on the floor, metres, world,
    passes an occupied cell of the map lower than a wall is high; never for an eye above the rooms. The map shows one
    storey."""
    if not len(feet):
        return np.zeros(0, np.bool_)
    way = feet - eye
    length = np.hypot(way[:, 0], way[:, 1])
    looks = int(np.clip(np.ceil(length.max() / _STEP), 1, _MOST))
    share = (np.arange(looks) + 0.5) / looks  # of the way from the eye
    places = eye[:2] + share[None, :, None] * way[:, None, :2]
    height = (1.0 - share)[None, :] * -way[:, 2:]  # above the floor at the foot
    counts = (way[:, 2:] > -_ABOVE) & (height < WALL) & ((1.0 - share)[None, :] * length[:, None] > _NEAR)
    return np.asarray(((occupancy.at(places) == OCCUPIED) & counts).any(axis=1), np.bool_)
