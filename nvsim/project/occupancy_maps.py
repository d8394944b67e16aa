"""The occupancy maps of a project: the true map of the built-in building, the map built from measured surfaces, and one
for display that is computed from the cloud and the floor masks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.sweeps import Sweep
from nvsim.capture.types import Capture, Cloud
from nvsim.errors import InputError
from nvsim.events import Listener, Progress, ignore_event
from nvsim.geometry.cells import grid_size
from nvsim.geometry.floor_surface import FloorSurface, StackedFloor
from nvsim.geometry.sampling import STRIDE, places_between
from nvsim.occupancy.ros import Provenance, read_provenance
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, Heights, OccupancyMap
from nvsim.perception.floor_height import estimate_floor
from nvsim.perception.support import FloorSupport
from nvsim.perception.support import positions_at_common_heights as carried_as_usual
from nvsim.project.floor_heights import floor_of
from nvsim.project.occupancy_sources import STAGE, MeasuredRays, source_digests
from nvsim.project.project import Project

_POINTS_PER_CELL = 2
_MOST_CELLS = 12_000_000
_BLOCK = 1 << 20  # points of a cloud that are processed at the same time
_COARSEST = 0.2  # meters
_SMALLEST = 12  # cells; smaller groups are noise of the point cloud
_APART = 0.3  # meters between the assumed viewpoints of a cloud
_LEVELS = 400_000  # points of sweeps that are used to estimate the floor height
_HIGHEST = 3.0  # meters over the floor; higher obstacles do not hide floor from a camera


def built_map(project: Project) -> Path | None:
    """The map in the project that was built from its capture. None if there is none, or if it belongs to another
    capture or was rendered from trained models. Raises InputError if it cannot be read."""
    path, capture = project.layout.occupancy, project.capture()
    if capture is None or not path.is_file():
        return None
    said = read_provenance(path)
    if said is None or said.source == "trained" or not set(said.makers) & set(source_digests(capture, None)):
        return None
    return path


def true_map(project: Project) -> Path | None:
    """The map file for comparison with the project, or the folder with the maps of its storeys: that of the built-in
    building, else the built map. None if there is none. Raises InputError like `built_map`."""
    return project.layout.true_map or built_map(project)


def refuse_own_depth(map: Path, project: Project) -> None:
    """Raises InputError if `map` was built from rendered depth of the project's own models, or of models of its
    trajectory. Such a map has the errors of these models and would confirm them."""
    said = read_provenance(map)
    if said is None or said.source != "trained":
        return
    if set(said.makers) & set(source_digests(project.need_capture(), project)):
        raise InputError(
            f"{map} was built from the rendered depth of this project's own models, so it cannot evaluate them; "
            "build a map with `nvsim occupancy build --source lidar`, depth or images."
        )


def occupancy_of(project: Project) -> OccupancyMap | None:
    """The map that users can compare the graph with: the true map of the built-in building, the map built from the
    capture, or one computed from the cloud and the floor masks. None if storeys overlap, because one map cannot show
    them."""
    truth = true_map(project)
    if truth is not None:
        from nvsim.occupancy.read import read_map

        return read_map(truth) if truth.is_file() else None
    capture, support = project.capture(), project.support()
    if capture is None or not isinstance(support, FloorSupport):
        return None
    return observed_occupancy(project, capture, support)


def observed_occupancy(project: Project, capture: Capture, support: FloorSupport) -> OccupancyMap:
    """A map for display, not ground truth, because a sparse cloud misses obstacles. Its cells of 0.05 m become coarser
    if the map would exceed the memory. Raises InputError if the cameras are too far apart for the coarsest cells."""
    resolution = 0.05
    positions = capture.positions[:, :2]
    floor = floor_of(project)
    cloud = project.scan_on(floor)
    points = np.zeros((0, 3), np.float32) if cloud is None else cloud.points
    low, high = positions.min(axis=0) - 8.0, positions.max(axis=0) + 8.0
    while np.prod((high - low) / resolution) > _MOST_CELLS and resolution < _COARSEST:
        resolution *= 2
    columns, rows = grid_size(low, high, resolution, "the cameras")
    empty = OccupancyMap(np.full((rows, columns), UNKNOWN, np.uint8), resolution, (float(low[0]), float(low[1])))
    cells = np.where(support.is_supported(empty.centers()), FREE, UNKNOWN)
    band, counts = Heights(), np.zeros(rows * columns, np.int64)
    for start in range(0, len(points), _BLOCK):
        part = points[start : start + _BLOCK]
        part = part[((part[:, :2] >= low) & (part[:, :2] < high)).all(axis=1)]
        above = part[:, 2] - floor.height_at(part[:, :2])
        index = empty.index(part[(above > band.from_height) & (above < band.to_height), :2])
        counts += np.bincount(index[:, 0] * columns + index[:, 1], minlength=rows * columns)
    occupied = (counts >= _POINTS_PER_CELL).reshape(rows, columns).astype(np.uint8)
    labels, sizes = cv2.connectedComponentsWithStats(occupied, connectivity=8)[1:3]
    solid = sizes[:, cv2.CC_STAT_AREA] >= _SMALLEST
    solid[0] = False  # the background
    cells[solid[labels]] = OCCUPIED
    return OccupancyMap(cells.astype(np.uint8), resolution, empty.origin)


# Building -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BuiltMap:
    """A built map and its statistics.

    cells_met  voxels crossed, summed over all rays
    unseen     points of a cloud that are visible from no viewpoint, which mark no cells as free
    """

    occupancy: OccupancyMap
    provenance: Provenance
    cells_met: int
    unseen: int = 0

    def area(self, state: np.uint8) -> float:
        """Area in square meters of the cells with `state` FREE, OCCUPIED or UNKNOWN."""
        return round(float(np.count_nonzero(self.occupancy.cells == state)) * self.occupancy.resolution**2, 2)


def build_occupancy(
    capture: Capture,
    project: Project | None,
    rays: MeasuredRays,
    resolution: float = 0.05,
    heights: Heights | None = None,
    *,
    reach: float | None = None,
    walked: float = 0.0,
    camera_height: float | None = None,
    listen: Listener = ignore_event,
) -> BuiltMap:
    """Builds the map from `rays`, in the aligned frame.

    resolution     meters per cell
    heights        range of heights over the local floor in which obstacles count
    reach          maximum length of rays in meters, None for that of `rays`
    walked         meters to either side of the trajectory that are marked free, regardless of the rays
    camera_height  meters over the floor, used if no measured floor is available

    Raises InputError if an option is out of range, the map would exceed the memory, the project has overlapping
    storeys, or no ray passes in the range of heights.
    """
    from nvsim.occupancy.ray_grid import RayGrid

    heights = heights or Heights()
    reach = rays.reach if reach is None else reach
    if not 0 <= walked <= 1:
        raise InputError(f"A path {2 * walked:g} m wide is out of range; give --walked a number of meters from 0 to 1.")
    if not 0 < reach <= 1000:
        raise InputError(f"Rays of {reach:g} m are out of range; give --reach a number of meters above 0, up to 1000.")
    floor = _floor(capture, project, rays, camera_height)
    low, high = rays.places[:, :2].min(axis=0) - reach, rays.places[:, :2].max(axis=0) + reach
    unseen = 0
    if rays.cloud is not None:
        low, high = np.maximum(low, rays.cloud[:, :2].min(axis=0)), np.minimum(high, rays.cloud[:, :2].max(axis=0))
        low, high = np.minimum(low, rays.places[:, :2].min(axis=0)), np.maximum(high, rays.places[:, :2].max(axis=0))
        carried = float((rays.places[:, 2] - floor.height_at(rays.places[:, :2])).max())
        grid = RayGrid(low, high, resolution, floor, heights, top=min(carried, _HIGHEST))
        unseen = grid.add_merged(rays.cloud, _spaced_places(rays.places), reach)
    else:
        grid = RayGrid(low, high, resolution, floor, heights)
        for done, sweep in enumerate(_sweeps(rays, floor)):
            listen(Progress(STAGE, done, rays.count))
            grid.add(sweep.points, sweep.origin, reach)
    listen(Progress(STAGE, rays.count, rays.count))
    occupancy = grid.flat()
    if not (occupancy.cells == FREE).any() and not (occupancy.cells == OCCUPIED).any():
        raise InputError(
            f"No ray passes between {heights.from_height:g} and {heights.to_height:g} m over the floor; "
            "give other heights with --from-height and --to-height."
        )
    note = rays.note
    if walked:
        occupancy, cells = _with_walk(occupancy, capture, floor, walked)
        area = cells * resolution**2
        note += f" The {walked:g} m to either side of the trajectory are marked free, which changed {area:.1f} m²."
    if rays.cloud is not None:
        note += f" {100 * unseen / len(rays.cloud):.0f} % of the points are visible from no camera and free no cells."
    provenance = Provenance(rays.source, note, heights.from_height, heights.to_height, source_digests(capture, project))
    return BuiltMap(occupancy, provenance, grid.steps, unseen)


def _with_walk(
    occupancy: OccupancyMap, capture: Capture, floor: FloorSurface, radius: float
) -> tuple[OccupancyMap, int]:
    """The map with all cells within `radius` meters of the trajectory marked free, and the number of changed cells."""
    from scipy.spatial import cKDTree

    walk = carried_as_usual(capture.positions, floor)[:, :2]
    meters, _ = cKDTree(places_between(walk, radius / 2, STRIDE)).query(occupancy.centers())
    new = (meters <= radius) & (occupancy.cells != FREE)
    return replace(occupancy, cells=np.where(new, FREE, occupancy.cells)), int(new.sum())


def _sweeps(rays: MeasuredRays, floor: FloorSurface) -> Iterator[Sweep]:
    assert rays.sweeps is not None  # rays without a cloud have sweeps
    return rays.sweeps(floor)


def _floor(capture: Capture, project: Project | None, rays: MeasuredRays, camera_height: float | None) -> FloorSurface:
    """The floor of the project if it was found, else an estimate from the measured points."""
    cloud = capture.cloud
    if project is not None:
        if any(project.surface(s.index) is not None for s in project.submaps_as_cut("floors")):
            floor = floor_of(project)
            if isinstance(floor, StackedFloor):
                raise InputError(
                    f"{project.layout.root} has overlapping storeys, which one map cannot show; "
                    "build the map of a capture of one storey."
                )
            return floor
        cloud = project.scan()
    if cloud is None or not cloud.is_dense:
        cloud = _subset_of_points(rays) if rays.source != "trained" else cloud
    return estimate_floor(cloud, capture.positions, camera_height)


def _subset_of_points(rays: MeasuredRays) -> Cloud:
    """An even subset of the points of all sweeps."""
    share = max(1, _LEVELS // rays.count)
    parts = []
    for sweep in _sweeps(rays, FloorSurface.flat(0.0)):
        near = sweep.points[np.linalg.norm(sweep.points - sweep.origin, axis=1) <= rays.reach]
        parts.append(near[:: max(1, len(near) // share)].astype(np.float32))
    return Cloud(np.concatenate([np.empty((0, 3), np.float32), *parts]))


def _spaced_places(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """A subset of `places` (N, 3): those at least 0.3 m from all previously selected ones."""
    from scipy.spatial import cKDTree

    near = cKDTree(places).query_ball_point(places, _APART)
    kept = np.zeros(len(places), bool)
    for i, others in enumerate(near):
        kept[i] = not kept[others].any()
    return places[kept]
