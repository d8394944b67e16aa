"""Two storeys, 0 and 3 m, and the stair between them: along x from 2 to 7, between y = 0 and 1."""

from __future__ import annotations

import numpy as np

from nvsim.geometry.floor_surface import FloorSurface, StackedFloor
from nvsim.perception.stacked_support import StackedSupport
from nvsim.perception.support import FloorSupport

SLOPE = 0.6  # meters upwards for one along x


def stairwell() -> StackedFloor:
    """The stair is in both storeys; nodes every 0.1 m."""
    x, y = np.meshgrid(np.arange(-2, 12, 0.1), np.arange(-4, 8, 0.1))
    on = (x > 1.95) & (x < 7.05) & (y > -0.05) & (y < 1.05)
    slope = np.clip(SLOPE * (x - 2), 0, 3)
    return StackedFloor(
        tuple(FloorSurface(np.where(on, slope, h).astype(np.float32), (-2.0, -4.0), 0.1) for h in (0.0, 3.0))
    )


def known_floor(floor: StackedFloor) -> StackedSupport:
    """Below everything before x = 2 and the room y > 1.1, above everything behind x = 7 and the room y < -0.1, and the
    stair; walls of 0.1 m lie along it. In cells of 0.1 m."""
    x, y = np.meshgrid(np.arange(-1.95, 12, 0.1), np.arange(-3.95, 8, 0.1))
    stair = (x > 1.9) & (x < 7.1) & (y > 0) & (y < 1)
    below = stair | (x < 2) | (y > 1.1)
    above = stair | (x > 7) | (y < -0.1)
    return StackedSupport(floor, tuple(FloorSupport(known, (-2.0, -4.0), 0.1) for known in (below, above)))
