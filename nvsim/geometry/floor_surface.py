"""The floor as a height over the ground plane: a coarse grid, because a spurious tilt of 0.3 degrees moves a floor by
10 cm over 20 m, so that heights are local."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.stored_arrays import read_arrays
from nvsim.geometry import grid_values

_FEW = 2  # places, for which a window that has not compiled anything does not wait for a second


@dataclass(frozen=True, eq=False)
class FloorSurface:
    """Floor heights on a regular grid over world x, y.

    heights   (rows, columns) float32, metres, world z; every cell filled; row index follows y, column index x
    origin    (x, y) metres of the centre of cell [0, 0]
    spacing   metres between cell centres
    """

    heights: NDArray[np.float32]
    origin: tuple[float, float]
    spacing: float

    @staticmethod
    def flat(height: float) -> FloorSurface:
        """One height everywhere."""
        return FloorSurface(np.full((1, 1), height, np.float32), (0.0, 0.0), 1.0)

    @staticmethod
    def load(path: Path) -> FloorSurface:
        """The surface in an .npz of heights, origin and spacing. Raises InputError for a file that is missing, damaged
        or something else."""
        again = "run `nvsim floors --project` again"
        arrays = read_arrays(
            path, "a floor surface", {"heights": ("f", 2), "origin": ("fi", 1), "spacing": ("fi", 0)}, again
        )
        heights, origin, spacing = arrays["heights"], arrays["origin"], float(arrays["spacing"])
        if not (
            heights.size and np.isfinite(heights).all() and origin.shape == (2,) and np.isfinite(origin).all()
        ) or not (np.isfinite(spacing) and spacing > 0):
            raise InputError(f"{path} holds no floor surface (empty, or numbers that are not finite); {again}.")
        return FloorSurface(heights.astype(np.float32), (float(origin[0]), float(origin[1])), spacing)

    def height_at(self, xy: NDArray[np.floating]) -> NDArray[np.float32]:
        """Heights (...) at world x, y (..., 2): bilinear inside, the nearest border value outside. Of points (..., 3) z
        counts for nothing: there is one floor."""
        xy = np.asarray(xy)
        places = np.ascontiguousarray(xy.reshape(-1, xy.shape[-1]), np.float64)
        found = np.empty(len(places), np.float32)
        _values(len(places)).bilinear(self.heights, *self.origin, self.spacing, places, found)
        return found.reshape(xy.shape[:-1])

    def meet(
        self, origin: NDArray[np.floating], directions: NDArray[np.floating], iterations: int = 4
    ) -> NDArray[np.float32]:
        """Where rays meet the floor: distances (...) along unit `directions` (..., 3) from `origin` (3,); inf where a
        ray does not point down by at least 0.02. Fixed-point iteration, exact for a flat floor."""
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
    """Who reads a grid at so many places."""
    if places <= _FEW:
        return grid_values
    from nvsim.geometry import grid_kernels

    return grid_kernels
