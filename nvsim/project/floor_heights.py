"""The floor of the whole project: each place takes the height of the submap with the nearest camera."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from nvsim.geometry.cells import grid_size
from nvsim.geometry.floor_surface import FloorSurface

if TYPE_CHECKING:
    from nvsim.project.project import Project

_SPACING = 0.5  # metres
_MARGIN = 8.0  # metres around the cameras


def floor_of(project: Project) -> FloorSurface:
    """One surface over the trajectory and what can be seen from it; flat at z = 0 while no floor was estimated."""
    from scipy.spatial import cKDTree

    surfaces = {s.index: project.surface(s.index) for s in project.submaps("floors")}
    known = {index: s for index, s in surfaces.items() if s is not None}
    if not known:
        return FloorSurface.flat(0.0)
    if len(known) == 1:
        return next(iter(known.values()))
    submaps = [s for s in project.submaps("floors") if s.index in known]
    places = np.concatenate([s.positions[:, :2] for s in submaps])
    owners = np.concatenate([np.full(len(s.positions), s.index) for s in submaps])
    low, high = places.min(axis=0) - _MARGIN, places.max(axis=0) + _MARGIN
    columns, rows = (side + 1 for side in grid_size(low, high, _SPACING, "the cameras"))
    x, y = low[0] + _SPACING * np.arange(columns), low[1] + _SPACING * np.arange(rows)
    xy = np.stack(np.meshgrid(x, y), axis=-1)
    nearest = owners[cKDTree(places).query(xy)[1]]
    heights = np.zeros((rows, columns), np.float32)
    for index, surface in known.items():
        chosen = nearest == index
        heights[chosen] = surface.height_at(xy[chosen])
    return FloorSurface(heights, (float(low[0]), float(low[1])), _SPACING)


def floor_beneath(project: Project) -> Callable[[float, float, float], float] | None:
    """(x, y, z) -> height of the floor under what is at z, metres, world: that of the submap whose camera passed
    nearest, so that storeys stay apart. None while no floor was estimated."""
    surfaces = {s.index: project.surface(s.index) for s in project.submaps("floors")}
    known = {index: s for index, s in surfaces.items() if s is not None}
    if not known:
        return None
    from scipy.spatial import cKDTree

    submaps = [s for s in project.submaps("floors") if s.index in known]
    tree = cKDTree(np.concatenate([s.positions for s in submaps]))
    owners = np.concatenate([np.full(len(s.positions), s.index) for s in submaps])

    def height(x: float, y: float, z: float) -> float:
        distance, row = tree.query((x, y, z))
        if distance > _MARGIN:
            return float("nan")
        return float(known[int(owners[row])].height_at(np.array([x, y])))

    return height
