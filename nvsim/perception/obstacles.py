"""What stands on the floor, as the cloud shows it: points that can hide floor, and floor that the cloud confirms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.perception.support import FloorSupport

Float32 = NDArray[np.float32]

_CELL = 0.05
_FOOT = 0.20  # what begins lower than this stands on the floor: a wall's lowest scanned row is not its foot
_FOOT_STEP = 0.03


@dataclass(frozen=True, eq=False)
class Standing:
    """points   (N, 3) float32, world, metres: everything above the floor, and feet down to the floor
    radii    (N,) float32, metres: half the width of the surface that a point stands for
    confirmed  floor that the cloud shows, None where the cloud is too sparse to say
    """

    points: Float32
    radii: Float32
    confirmed: FloorSupport | None


def standing(cloud: Cloud | None, surface: FloorSurface, clearance: float) -> Standing:
    """Sorts a cloud into what stands higher than `clearance` metres above the floor and what confirms floor."""
    nothing = Standing(np.empty((0, 3), np.float32), np.empty(0, np.float32), None)
    if cloud is None or len(cloud.points) < 10:
        return nothing
    points = np.asarray(cloud.points, np.float32)
    above = points[:, 2] - surface.height_at(points[:, :2])
    obstacles, height = points[above > clearance], above[above > clearance]
    feet = _feet(obstacles, height, surface)
    everything = np.ascontiguousarray(np.concatenate([obstacles, feet]), np.float32)
    radii = np.full(len(everything), 0.04, np.float32)
    return Standing(everything, radii, _confirmed(points[np.abs(above) <= clearance]))


def _feet(points: Float32, height: Float32, surface: FloorSurface) -> Float32:
    """Columns of points from the floor up to the lowest point of every cell that begins low: without them one sees the
    floor of the next room under the lowest scanned row of a wall."""
    low = height < _FOOT
    if not low.any():
        return np.empty((0, 3), np.float32)
    points, height = points[low], height[low]
    _, cell = np.unique(np.floor(points[:, :2] / _CELL).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    number = np.bincount(cell)
    xy = np.stack([np.bincount(cell, points[:, axis]) / number for axis in (0, 1)], axis=1)
    lowest = np.full(len(number), np.inf)
    np.minimum.at(lowest, cell, height)
    ground = surface.height_at(xy)
    layers = [
        np.column_stack([xy[lowest > z], ground[lowest > z] + z])
        for z in np.arange(0.5 * _FOOT_STEP, _FOOT, _FOOT_STEP)
    ]
    return np.concatenate(layers).astype(np.float32)


def _confirmed(points: Float32) -> FloorSupport:
    """The cells with floor points, gaps of up to about 0.3 m closed."""
    import cv2

    if len(points) == 0:
        return FloorSupport(np.zeros((1, 1), bool), (0.0, 0.0), _CELL)
    origin = points[:, :2].min(axis=0).astype(np.float64) - 0.5
    index = np.floor((points[:, :2] - origin) / _CELL).astype(np.int64)
    grid = np.zeros((int(index[:, 1].max()) + 11, int(index[:, 0].max()) + 11), np.uint8)
    grid[index[:, 1], index[:, 0]] = 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    closed = cv2.morphologyEx(grid, cv2.MORPH_CLOSE, disc) > 0
    return FloorSupport(closed, (float(origin[0]), float(origin[1])), _CELL)
