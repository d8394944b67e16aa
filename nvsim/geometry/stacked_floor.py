"""Floors over one another: a height over the ground plane for each storey, chosen by how high one is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.floor_surface import FloorSurface

_UNDER = 0.5  # metres that a height may lie below the floor it is near
_STEP = 0.1  # metres between neighbouring nodes, from which on they are of different floors


@dataclass(frozen=True, eq=False)
class StackedFloor:
    """storeys: the floor of each, the lowest first; what joins two, a stair, is in both of them."""

    storeys: tuple[FloorSurface, ...]

    def storey_at(self, points: NDArray[np.floating]) -> NDArray[np.int64]:
        """(...) the storey of world points (..., 3), whose z is the height of a camera or of a floor: the highest with
        its floor not above them; the lowest where there is none. Of places (..., 2) the lowest."""
        if points.shape[-1] < 3:
            return np.zeros(points.shape[:-1], np.int64)
        found = np.zeros(points.shape[:-1], np.int64)
        for k, floor in enumerate(self.storeys[1:], 1):
            found[_height(floor, points) <= points[..., 2] + _UNDER] = k
        return found

    def height_at(self, points: NDArray[np.floating]) -> NDArray[np.float32]:
        """Heights (...) of the floor of the storey at world points (..., 3), as `storey_at` chooses it, metres; of the
        lowest one at places (..., 2)."""
        found = self.storey_at(points)
        heights = _height(self.storeys[0], points)
        for k, floor in enumerate(self.storeys[1:], 1):
            if (found == k).any():
                heights = np.where(found == k, _height(floor, points), heights)
        return np.asarray(heights, np.float32)


def _height(floor: FloorSurface, points: NDArray[np.floating]) -> NDArray[np.float32]:
    """Heights (...) of one storey: where it steps from a stair to the floor beside it, that of the nearest node, as
    between the two there is no floor."""
    smooth = floor.height_at(points)
    rows, columns = floor.heights.shape
    c = np.clip(np.round((points[..., 0] - floor.origin[0]) / floor.spacing), 0, columns - 1).astype(np.int64)
    r = np.clip(np.round((points[..., 1] - floor.origin[1]) / floor.spacing), 0, rows - 1).astype(np.int64)
    nearest = floor.heights[r, c]
    return np.where(np.abs(smooth - nearest) > _STEP, nearest, smooth)


Floor = FloorSurface | StackedFloor
