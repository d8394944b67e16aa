"""Tests which points are behind walls of the occupancy map, seen from a camera. Does not use widgets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.occupancy.types import OCCUPIED, OccupancyMap

WALL = 2.2  # assumed height of obstacles in meters, because the map has no heights
_ABOVE = 3.0  # meters above the floor; a higher camera is above the rooms
_STEP = 0.1  # meters between two samples along a ray
_MOST = 250  # maximum number of samples per ray; longer rays are sampled more coarsely
_NEAR = 0.3  # meters at the end of the ray that are ignored, because a point beside a wall is not behind it


def behind_walls(occupancy: OccupancyMap, eye: NDArray[np.floating], feet: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(N,) bool, whether the segment from `eye` (3,) to each of the floor points `feet` (N, 3) passes an occupied cell
    below wall height. All points are in meters, world.

    All are False for a camera above the rooms. The map must show one storey."""
    if not len(feet):
        return np.zeros(0, np.bool_)
    way = feet - eye
    length = np.hypot(way[:, 0], way[:, 1])
    looks = int(np.clip(np.ceil(length.max() / _STEP), 1, _MOST))
    share = (np.arange(looks) + 0.5) / looks  # of the distance from the eye
    places = eye[:2] + share[None, :, None] * way[:, None, :2]
    height = (1.0 - share)[None, :] * -way[:, 2:]  # above the floor at the foot
    counts = (way[:, 2:] > -_ABOVE) & (height < WALL) & ((1.0 - share)[None, :] * length[:, None] > _NEAR)
    return np.asarray(((occupancy.at(places) == OCCUPIED) & counts).any(axis=1), np.bool_)
