"""The floor as a height map over the ground plane, one per storey if storeys are stacked.

Heights are local, on a coarse grid: a false tilt of 0.3 degrees would move a floor by 10 cm over 20 m.

On stacked floors, the height of a point selects the storey.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.stored_arrays import read_arrays
from nvsim.geometry import grid_values

_FEW = 2  # points up to which uncompiled code is used, because compilation takes a second in a new process


@dataclass(frozen=True, eq=False)
class FloorSurface:
    """Floor heights on a regular grid over world x, y.

    heights   (rows, columns) float32, meters, world z; every cell has a value; rows follow y, columns follow x
    origin    (x, y) meters of the center of cell [0, 0]
    spacing   meters between cell centers
    """

    heights: NDArray[np.float32]
    origin: tuple[float, float]
    spacing: float

    @staticmethod
    def flat(height: float) -> FloorSurface:
        """A surface with one height in meters everywhere."""
        return FloorSurface(np.full((1, 1), height, np.float32), (0.0, 0.0), 1.0)

    @staticmethod
    def load(path: Path) -> FloorSurface:
        """The surface in an .npz file of heights, origin, and spacing. Raises InputError if the file is missing,
        damaged, or of another kind."""
        again = "run `nvsim floors --project` again"
        arrays = read_arrays(
            path, "a floor surface", {"heights": ("f", 2), "origin": ("fi", 1), "spacing": ("fi", 0)}, again
        )
        heights, origin, spacing = arrays["heights"], arrays["origin"], float(arrays["spacing"])
        if not (
            heights.size and np.isfinite(heights).all() and origin.shape == (2,) and np.isfinite(origin).all()
        ) or not (np.isfinite(spacing) and spacing > 0):
            raise InputError(f"{path} holds no floor surface (empty, or with numbers that are not finite); {again}.")
        return FloorSurface(heights.astype(np.float32), (float(origin[0]), float(origin[1])), spacing)

    def height_at(self, xy: NDArray[np.floating]) -> NDArray[np.float32]:
        """Heights (...,) float32 in meters at world x, y (..., 2): bilinear inside, the nearest border value outside.

        Points (..., 3) are also accepted; their z is ignored, because there is one floor."""
        xy = np.asarray(xy)
        places = np.ascontiguousarray(xy.reshape(-1, xy.shape[-1]), np.float64)
        found = np.empty(len(places), np.float32)
        _values(len(places)).bilinear(self.heights, *self.origin, self.spacing, places, found)
        return found.reshape(xy.shape[:-1])

    def distance_along_rays(
        self, origin: NDArray[np.floating], directions: NDArray[np.floating], iterations: int = 4
    ) -> NDArray[np.float32]:
        """Distances (...,) float32 in meters to the floor along unit `directions` (..., 3) from `origin` (3,), meters.

        They are inf for rays that do not point down by at least 0.02. Fixed-point iteration; exact for a flat floor."""
        down = directions[..., 2] < -0.02
        slope = np.where(down, -directions[..., 2], 1.0)
        height = np.full(directions.shape[:-1], self.height_at(np.asarray(origin)[:2]), np.float32)
        distance = (origin[2] - height) / slope
        if self.heights.size > 1:
            for _ in range(iterations):
                height = self.height_at(origin[:2] + distance[..., None] * directions[..., :2])
                distance = (origin[2] - height) / slope
        return np.where(down & (distance > 0), distance, np.inf).astype(np.float32)


def _values(places: int) -> ModuleType:
    """The module that interpolates a grid at this number of places."""
    if places <= _FEW:
        return grid_values
    from nvsim.geometry import grid_kernels

    return grid_kernels


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
