"""The floor of the whole project: each place has the floor height of the submap with the nearest camera."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.cells import grid_size
from nvsim.geometry.floor_surface import Floor, FloorSurface, StackedFloor
from nvsim.submaps.split import TrajectoryStoreys, storeys_of

if TYPE_CHECKING:
    from nvsim.project.project import Project

_SPACING = 0.5  # meters
_FINE = 0.1  # meters, if storeys overlap: only a wall separates the floor beside a stair from its steps
_STAIR = 0.6  # meters from the cameras on a stair to its sides
_MARGIN = 8.0  # meters around the cameras


def floor_of(project: Project) -> Floor:
    """One surface around the trajectory; flat at z = 0 while no floor is estimated. If storeys overlap, one surface per
    storey."""
    surfaces = {s.index: project.surface(s.index) for s in project.submaps_as_cut("floors")}
    known = {index: s for index, s in surfaces.items() if s is not None}
    if not known:
        return FloorSurface.flat(0.0)
    submaps = [s for s in project.submaps_as_cut("floors") if s.index in known]
    positions = np.concatenate([s.positions for s in submaps])
    owners = np.concatenate([np.full(len(s.positions), s.index) for s in submaps])
    storeys = storeys_of(positions)
    if len(storeys.levels) > 1:
        return stacked_floor(positions, owners, known, storeys)
    if len(known) == 1:
        return next(iter(known.values()))
    return _surface_around(positions[:, :2], positions[:, :2], owners, known, _SPACING)


def floors_seen(project: Project) -> dict[int, FloorSurface]:
    """Frame index -> floor surface around the frame, one shared object for all frames that are segmented together.

    The surface is that of the submap with the frame in its core. If storeys overlap, it is that of the camera's storey
    with the stairs to other storeys. On a stair, it joins the lower and the upper storey. Frames of submaps without a
    floor are skipped.
    """
    floor, positions = floor_of(project), project.need_capture().positions
    storeys, found = storeys_of(positions), {}
    seen: list[FloorSurface] = []
    if isinstance(floor, StackedFloor):
        for k, surface in enumerate(floor.storeys[:-1]):
            stair = positions[storeys.part == 2 * k + 1]
            seen += [surface, _from_stair(surface, floor.storeys[k + 1], stair)]
        seen.append(floor.storeys[-1])
    for submap in project.submaps("floors"):
        own = project.surface(submap.index)
        if own is None:
            continue
        floors = [replace(surface) for surface in seen]
        found.update({frame: floors[storeys.part[frame]] if floors else own for frame in submap.core})
    return found


def _from_stair(lower: FloorSurface, upper: FloorSurface, cameras: NDArray[np.float64]) -> FloorSurface:
    """Floor as seen by `cameras` (N, 3) on a stair: the lower storey around its lower half, the upper storey around its
    upper half. Both surfaces must have equal nodes."""
    from scipy.spatial import cKDTree

    if not len(cameras):
        return lower
    rows, columns = lower.heights.shape
    x, y = (lower.origin[a] + lower.spacing * np.arange(n) for a, n in enumerate((columns, rows)))
    nearest = cKDTree(cameras[:, :2]).query(np.stack(np.meshgrid(x, y), axis=-1))[1]
    below = cameras[nearest, 2] < 0.5 * (cameras[:, 2].min() + cameras[:, 2].max())
    return replace(lower, heights=np.where(below, lower.heights, upper.heights))


def stacked_floor(
    positions: NDArray[np.float64],
    owners: NDArray[np.int64],
    surfaces: dict[int, FloorSurface],
    storeys: TrajectoryStoreys,
) -> StackedFloor:
    """The floor of each storey.

    positions  (N, 3) cameras in meters, world
    owners     (N,) index of the submap that has the camera
    surfaces   floor of each submap

    A place has the floor of the submap with the nearest camera on this storey. Under cameras on a stair, it has the
    floor of the stair.
    """
    from scipy.spatial import cKDTree

    floors = []
    for k in range(len(storeys.levels)):
        level, stair = storeys.part == 2 * k, np.abs(storeys.part - 2 * k) == 1
        surface = _surface_around(positions[:, :2], positions[level, :2], owners[level], surfaces, _FINE)
        if stair.any():
            slope = _surface_around(positions[:, :2], positions[stair, :2], owners[stair], surfaces, _FINE)
            rows, columns = surface.heights.shape
            x, y = (surface.origin[a] + _FINE * np.arange(n) for a, n in enumerate((columns, rows)))
            distance, _ = cKDTree(positions[stair, :2]).query(np.stack(np.meshgrid(x, y), axis=-1))
            heights = np.where(distance <= _STAIR, slope.heights, surface.heights)
            surface = FloorSurface(heights, surface.origin, _FINE)
        floors.append(surface)
    return StackedFloor(tuple(floors))


def _surface_around(
    around: NDArray[np.float64],
    places: NDArray[np.float64],
    owners: NDArray[np.int64],
    surfaces: dict[int, FloorSurface],
    spacing: float,
) -> FloorSurface:
    """One surface around the positions `around` (M, 2), with nodes `spacing` meters apart. Each node has the height of
    the owner (N,) of the nearest of `places` (N, 2)."""
    from scipy.spatial import cKDTree

    low, high = around.min(axis=0) - _MARGIN, around.max(axis=0) + _MARGIN
    columns, rows = (side + 1 for side in grid_size(low, high, spacing, "the cameras"))
    x, y = low[0] + spacing * np.arange(columns), low[1] + spacing * np.arange(rows)
    xy = np.stack(np.meshgrid(x, y), axis=-1)
    nearest = owners[cKDTree(places).query(xy)[1]]
    heights = np.zeros((rows, columns), np.float32)
    for index, surface in surfaces.items():
        chosen = nearest == index
        heights[chosen] = surface.height_at(xy[chosen])
    return FloorSurface(heights, (float(low[0]), float(low[1])), spacing)


def floor_beneath(project: Project) -> Callable[[float, float, float], float] | None:
    """Function (x, y, z) -> height of the floor under this point, all in meters, world. The floor is that of the submap
    with the nearest camera, so that storeys stay separate. NaN more than 8 m from all cameras. Returns None while no
    floor is estimated."""
    surfaces = {s.index: project.surface(s.index) for s in project.submaps_as_cut("floors")}
    known = {index: s for index, s in surfaces.items() if s is not None}
    if not known:
        return None
    from scipy.spatial import cKDTree

    submaps = [s for s in project.submaps_as_cut("floors") if s.index in known]
    tree = cKDTree(np.concatenate([s.positions for s in submaps]))
    owners = np.concatenate([np.full(len(s.positions), s.index) for s in submaps])

    def height(x: float, y: float, z: float) -> float:
        distance, row = tree.query((x, y, z))
        if distance > _MARGIN:
            return float("nan")
        return float(known[int(owners[row])].height_at(np.array([x, y])))

    return height
