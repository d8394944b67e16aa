"""Who sees whom, asked of an occupancy map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.edits import Visible
from nvsim.occupancy.types import OccupancyMap


def sight_on(occupancy: OccupancyMap, radius: float = 0.0) -> Visible:
    """Two places see each other when a disc of `radius` metres can go straight from one to the other on the map, over
    free cells only. The map knows one floor."""
    from nvsim.occupancy.paths import segments_are_free, standing_room

    room = standing_room(occupancy, radius)

    def visible(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
        return segments_are_free(room, occupancy, a[:, :2], b[:, :2])

    return visible
