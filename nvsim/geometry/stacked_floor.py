"""Floors of stacked storeys: one height map per storey. The height of a point selects the storey."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface

_UNDER = 0.5  # meters that a height may be below the floor of its storey
_STEP = 0.1  # meters between neighboring nodes above which they belong to different floors


@dataclass(frozen=True, eq=False)
class StackedFloor:
    """storeys: floor surface of each storey, lowest first. A stair between two storeys is in both surfaces."""

    storeys: tuple[FloorSurface, ...]

    def storey_at(self, points: NDArray[np.floating]) -> NDArray[np.int64]:
        """(...,) int64 storey of world points (..., 3), whose z is the height of a camera or of a floor, meters.

        It is the highest storey whose floor is not above the point, or else the lowest storey. For points (..., 2), it
        is the lowest storey."""
        if points.shape[-1] < 3:
            return np.zeros(points.shape[:-1], np.int64)
        found = np.zeros(points.shape[:-1], np.int64)
        for k, floor in enumerate(self.storeys[1:], 1):
            found[_height(floor, points) <= points[..., 2] + _UNDER] = k
        return found

    def height_at(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """(...,) float32 floor heights in meters at world points (..., 3), on the storey that `storey_at` selects. For
        points (..., 2), the heights of the lowest storey."""
        found = self.storey_at(points)
        heights = _height(self.storeys[0], points)
        for k, floor in enumerate(self.storeys[1:], 1):
            if (found == k).any():
                heights = np.where(found == k, _height(floor, points), heights)
        return np.asarray(heights, np.float32)


def _height(floor: FloorSurface, points: NDArray[np.floating]) -> NDArray[np.float32]:
    """Heights (...,) of one storey. Between a stair and the floor beside it, there is no floor, so at such a step the
    height of the nearest node is used."""
    smooth = floor.height_at(points)
    rows, columns = floor.heights.shape
    c = np.clip(np.round((points[..., 0] - floor.origin[0]) / floor.spacing), 0, columns - 1).astype(np.int64)
    r = np.clip(np.round((points[..., 1] - floor.origin[1]) / floor.spacing), 0, rows - 1).astype(np.int64)
    nearest = floor.heights[r, c]
    return np.where(np.abs(smooth - nearest) > _STEP, nearest, smooth)


Floor = FloorSurface | StackedFloor
