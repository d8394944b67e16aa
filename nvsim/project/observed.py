"""Computes an occupancy map from the capture: supported floor is free, and cloud points above it are obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from nvsim.capture.types import Capture
from nvsim.geometry.cells import grid_size
from nvsim.occupancy.heights import Heights
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, OccupancyMap
from nvsim.perception.support import FloorSupport
from nvsim.project.floor_heights import floor_of

if TYPE_CHECKING:
    from nvsim.project.project import Project

_POINTS_PER_CELL = 2
_MOST_CELLS = 12_000_000
_COARSEST = 0.2  # meters
_SMALLEST = 12  # cells; smaller groups are noise of the point cloud


def observed_occupancy(
    project: Project, capture: Capture, support: FloorSupport, resolution: float = 0.05
) -> OccupancyMap:
    """A map for display, not ground truth, because a sparse cloud misses obstacles. `resolution` is in meters per cell
    and becomes coarser if the map would exceed the memory. Raises InputError if the cameras are too far apart for the
    coarsest resolution."""
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
