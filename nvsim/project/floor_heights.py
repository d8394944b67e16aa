"""Floor heights of the whole project: each place asks the submap whose cameras are nearest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.geometry.floor_surface import FloorSurface
from nvsim.project.project import Project


class FloorHeights:
    """Callable: world x, y (..., 2) -> heights (...) float32, metres."""

    def __init__(self, project: Project) -> None:
        owners, places, self._surfaces = [], [], {}
        for submap in project.need_submaps():
            surface = project.surface(submap.index)
            if surface is None:
                continue
            self._surfaces[submap.index] = surface
            places.append(submap.positions[:, :2])
            owners.append(np.full(len(submap.positions), submap.index))
        if not self._surfaces:
            places, owners, self._surfaces = [np.zeros((1, 2))], [np.zeros(1, int)], {0: FloorSurface.flat(0.0)}
        self._tree = cKDTree(np.concatenate(places))
        self._owners = np.concatenate(owners)

    def __call__(self, xy: NDArray[np.floating]) -> NDArray[np.float32]:
        flat = np.asarray(xy, np.float64).reshape(-1, 2)
        owners = self._owners[self._tree.query(flat)[1]]
        heights = np.empty(len(flat), np.float32)
        for index, surface in self._surfaces.items():
            chosen = owners == index
            heights[chosen] = surface.height_at(flat[chosen])
        return heights.reshape(np.shape(xy)[:-1])
