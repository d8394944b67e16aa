"""Obstacles from the point cloud: points that can occlude floor, and floor that the cloud confirms."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.capture.types import Cloud
from nvsim.geometry.cells import MOST_CELLS, distinct_cells
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.nearest_points import distance_to
from nvsim.perception.stairs import Stairs
from nvsim.perception.support import FloorSupport

Float32 = NDArray[np.float32]

_CELL = 0.05
_FOOT = 0.20  # meters: objects that begin lower stand on the floor, because scans miss the lowest part of a wall
_FOOT_STEP = 0.03
_UNDER = 0.125  # meters around a foot: with floor on all sides of this disc, the object does not touch the floor
_OPEN = 0.7  # least share of the usual number of floor points in each half of that disc
_OVER, _TOP = 0.2, 1.2  # meters: radius of the disc, and greatest height of the points, that show an overhang
_ROOF = 0.8  # least share of one half of that disc that the overhang covers
_NEIGHBORHOOD = 0.4
_RIM = 1  # cells
_HOLE = 1.0  # square meters: unscanned areas up to this size are floor if floor surrounds them


@dataclass(frozen=True, eq=False)
class ObstacleCloud:
    """points   (N, 3) float32, world, meters: all points above the floor, and added points from their feet to the floor
    radii    (N,) float32, meters: half the width of the surface that a point represents
    confirmed  floor that the cloud shows; None if the cloud is missing or has fewer than 10 points
    """

    points: Float32
    radii: Float32
    confirmed: FloorSupport | None


def split_obstacles(
    cloud: Cloud | None, surface: FloorSurface, clearance: float, cover: float, sparse: float
) -> ObstacleCloud:
    """Splits a cloud into obstacles higher than `clearance` meters above the floor and points that confirm floor. On
    stairs both limits are half a step higher.

    cover   half-width of a point's square, in distances to its fourth neighbor
    sparse  a surface whose points are this many times as far apart as the median is glass or noise
    """
    nothing = ObstacleCloud(np.empty((0, 3), np.float32), np.empty(0, np.float32), None)
    if cloud is None or len(cloud.points) < 10:
        return nothing
    points = np.asarray(cloud.points, np.float32)
    above = points[:, 2] - surface.height_at(points[:, :2])
    clear = clearance + Stairs.of(surface).half_step(points)
    obstacles, height = points[above > clear], above[above > clear]
    on_floor = points[np.abs(above) <= clear]
    feet = _extend_to_floor(obstacles, height, on_floor, surface)
    everything = np.ascontiguousarray(np.concatenate([obstacles, feet]), np.float32)
    spacing = distance_to(everything, 4)
    # A surface with far fewer points than the rest is glass or noise: surfaces behind it are visible.
    around = _local_mean(everything, spacing)
    solid = around <= sparse * float(np.median(around)) if len(spacing) else np.empty(0, bool)
    radii = np.where(solid, np.clip(cover * spacing, 0.03, 0.2), 0.02).astype(np.float32)
    return ObstacleCloud(everything, radii, _confirmed_floor(on_floor, surface))


def _local_mean(points: Float32, values: Float32) -> Float32:
    """(N,) the mean of `values` (N,) over all points in one cube of _NEIGHBORHOOD meters."""
    if len(points) == 0:
        return values
    cube = np.floor((points - points.min(axis=0)) / _NEIGHBORHOOD).astype(np.int64)
    sizes = cube.max(axis=0) + 1
    _, member = np.unique((cube[:, 2] * sizes[1] + cube[:, 1]) * sizes[0] + cube[:, 0], return_inverse=True)
    member = member.reshape(-1)
    mean: Float32 = (np.bincount(member, values) / np.bincount(member))[member].astype(np.float32)
    return mean


def _extend_to_floor(points: Float32, height: Float32, on_floor: Float32, surface: FloorSurface) -> Float32:
    """Added points (K, 3) from the floor up to the lowest point of every low cell. Without them the floor of the next
    room would be visible under the lowest scanned row of a wall. Raised objects get none: those with floor points
    `on_floor` (M, 3) below them."""
    low = height < _FOOT
    if not low.any():
        return np.empty((0, 3), np.float32)
    things, points, height = points[height < _TOP], points[low], height[low]
    _, cell = distinct_cells(np.floor(points[:, :2] / _CELL).astype(np.int64))
    number = np.bincount(cell)
    xy = np.stack([np.bincount(cell, points[:, axis]) / number for axis in (0, 1)], axis=1)
    lowest = np.full(len(number), np.inf)
    np.minimum.at(lowest, cell, height)
    standing = ~_are_raised(xy, on_floor, things)
    xy, lowest = xy[standing], lowest[standing]
    ground = surface.height_at(xy)
    layers = [
        np.column_stack([xy[lowest > z], ground[lowest > z] + z])
        for z in np.arange(0.5 * _FOOT_STEP, _FOOT, _FOOT_STEP)
    ]
    return np.concatenate(layers).astype(np.float32)


def _are_raised(xy: NDArray[np.float64], on_floor: Float32, things: Float32) -> NDArray[np.bool_]:
    """(N,) bool: which of the places `xy` (N, 2) of lowest object points are above visible floor. There, floor points
    (M, 3) are on all sides, and the object's points (K, 3) cover one side, as with a sofa on short legs. Legs, rails,
    and the foot of a pane that the LiDAR scan misses do not meet both conditions."""
    if len(on_floor) < 2:
        return np.zeros(len(xy), bool)
    floor = cKDTree(on_floor[:, :2])
    usual = np.median(
        floor.query_ball_point(on_floor[:: max(1, len(on_floor) // 2000), :2], _UNDER, return_length=True)
    )
    found = _counts_in_half_discs(floor, xy, _UNDER).min(axis=0) > 0.5 * _OPEN * usual
    over = cKDTree(_CELL * (0.5 + distinct_cells(np.floor(things[:, :2] / _CELL).astype(np.int64))[0]))
    cells = 0.5 * np.pi * (_OVER / _CELL) ** 2
    found[found] = _counts_in_half_discs(over, xy[found], _OVER).max(axis=0) > _ROOF * cells
    return found


def _counts_in_half_discs(tree: cKDTree, xy: NDArray[np.float64], radius: float) -> NDArray[np.int64]:
    """(8, N) number of points of a `tree` within `radius` meters of each of `xy` (N, 2), in the half disc that faces
    each of eight directions."""
    near = tree.query_ball_point(xy, radius, workers=2)
    place = np.repeat(np.arange(len(xy)), [len(n) for n in near])
    index = np.fromiter(chain.from_iterable(near), np.int64, len(place))
    away = np.asarray(tree.data)[index] - xy[place]
    turns = np.arange(8) * np.pi / 4
    return np.array([np.bincount(place[away @ (np.cos(t), np.sin(t)) > 0], minlength=len(xy)) for t in turns])


def _confirmed_floor(points: Float32, surface: FloorSurface) -> FloorSupport:
    """The cells with floor points, with gaps of up to about 0.3 m closed."""
    import cv2

    far = np.abs(points[:, :2] - _middle(surface)).max(axis=1, initial=0.0)
    if len(points) and (np.ptp(points[:, :2], axis=0) / _CELL).prod() > MOST_CELLS:
        points = points[far < 0.5 * _CELL * np.sqrt(MOST_CELLS)]  # points beyond belong to no room of this surface
    if len(points) == 0:
        return FloorSupport(np.zeros((1, 1), bool), (0.0, 0.0), _CELL)
    origin = points[:, :2].min(axis=0).astype(np.float64) - 0.5
    index = np.floor((points[:, :2] - origin) / _CELL).astype(np.int64)
    grid = np.zeros((int(index[:, 1].max()) + 11, int(index[:, 0].max()) + 11), np.uint8)
    grid[index[:, 1], index[:, 0]] = 1
    gap = 2.5 * float(np.median(distance_to(points, 4)))
    size = 2 * max(3, round(gap / _CELL)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
    wide = cv2.morphologyEx(np.pad(grid, size), cv2.MORPH_CLOSE, disc)
    grid = np.asarray(wide[size:-size, size:-size], np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats((grid == 0).astype(np.uint8), connectivity=4)
    hole = stats[:, cv2.CC_STAT_AREA] * _CELL**2 < _HOLE
    # The outermost floor point is up to one gap before the wall; cells behind the wall are occluded anyway.
    rim = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _RIM + 1, 2 * _RIM + 1))
    closed = cv2.dilate(((grid > 0) | hole[labels]).astype(np.uint8), rim) > 0
    return FloorSupport(closed, (float(origin[0]), float(origin[1])), _CELL)


def _middle(surface: FloorSurface) -> NDArray[np.float64]:
    rows, columns = surface.heights.shape
    return np.array(surface.origin) + 0.5 * surface.spacing * np.array([columns - 1, rows - 1])
