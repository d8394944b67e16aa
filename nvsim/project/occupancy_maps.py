"""The occupancy maps of a project: the true map of the built-in building, the map built from the capture, and one for
display that is computed from the cloud and the floor masks."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from nvsim.capture.types import Capture
from nvsim.errors import InputError
from nvsim.geometry.cells import grid_size
from nvsim.occupancy.heights import Heights
from nvsim.occupancy.ros import read_provenance
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from nvsim.perception.support import FloorSupport
from nvsim.project.floor_heights import floor_of
from nvsim.project.project import Project

_POINTS_PER_CELL = 2
_MOST_CELLS = 12_000_000
_COARSEST = 0.2  # meters
_SMALLEST = 12  # cells; smaller groups are noise of the point cloud


def trajectory_digest(capture: Capture) -> str:
    """Hash of frame names and positions: equal for all imports of these frames with one alignment."""
    state = hashlib.sha256(json.dumps([f.name for f in capture.frames]).encode())
    state.update(np.ascontiguousarray(np.round(capture.positions, 6) + 0.0).tobytes())
    return state.hexdigest()[:24]


def makers_of(capture: Capture, project: Project | None) -> tuple[str, ...]:
    """The digest of the trajectory, and that of the project's folder if there is a project."""
    if project is None:
        return (trajectory_digest(capture),)
    place = hashlib.sha256(str(project.layout.root.resolve()).encode(errors="surrogatepass")).hexdigest()[:24]
    return trajectory_digest(capture), place


def built_map(project: Project) -> Path | None:
    """The map in the project that was built from its capture. None if there is none, or if it belongs to another
    capture or was rendered from trained models. Raises InputError if it cannot be read."""
    path, capture = project.layout.occupancy, project.capture()
    if capture is None or not path.is_file():
        return None
    said = read_provenance(path)
    if said is None or said.source == "trained" or not set(said.makers) & set(makers_of(capture, None)):
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
    if set(said.makers) & set(makers_of(project.need_capture(), project)):
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


def observed_occupancy(
    project: Project, capture: Capture, support: FloorSupport, resolution: float = 0.05
) -> OccupancyMap:
    """A map for display, not ground truth, because a sparse cloud misses obstacles. `resolution` is in meters per cell
    and becomes coarser if the map would exceed the memory. Raises InputError if the cameras are too far apart for the
    coarsest resolution."""
    import cv2

    positions = capture.positions[:, :2]
    floor = floor_of(project)
    cloud = project.scan_on(floor)
    points = np.zeros((0, 3), np.float32) if cloud is None else cloud.points
    low, high = positions.min(axis=0) - 8.0, positions.max(axis=0) + 8.0
    while np.prod((high - low) / resolution) > _MOST_CELLS and resolution < _COARSEST:
        resolution *= 2
    columns, rows = grid_size(low, high, resolution, "the cameras")
    empty = OccupancyMap(np.full((rows, columns), UNKNOWN, np.uint8), resolution, (float(low[0]), float(low[1])))
    cells = np.where(support.at(empty.centres()), FREE, UNKNOWN)
    inside = ((points[:, :2] >= low) & (points[:, :2] < high)).all(axis=1)
    points = points[inside]
    above = points[:, 2] - floor.height_at(points[:, :2])
    band = Heights()
    index = empty.index(points[(above > band.from_height) & (above < band.to_height), :2])
    counts = np.bincount(index[:, 0] * columns + index[:, 1], minlength=rows * columns).reshape(rows, columns)
    labels, sizes = cv2.connectedComponentsWithStats((counts >= _POINTS_PER_CELL).astype(np.uint8), connectivity=8)[1:3]
    solid = sizes[:, cv2.CC_STAT_AREA] >= _SMALLEST
    solid[0] = False  # the background
    cells[solid[labels]] = OCCUPIED
    return OccupancyMap(cells.astype(np.uint8), resolution, empty.origin)
