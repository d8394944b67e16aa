"""Obstacles from the point cloud: points that can occlude floor, and floor that the cloud confirms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from nvsim.capture.types import Capture, Cloud
from nvsim.depth.floor_noise import flatten_floor
from nvsim.geometry.cells import MOST_CELLS, distinct_cells, grid_size, near_places
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.nearest_points import distance_to
from nvsim.perception.stairs import Stairs
from nvsim.perception.support import FloorSupport
from nvsim.submaps.split import storeys_of

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
_SQUARE = 0.5  # meters: side of the cells of ground that belong to the frame nearest to them
_HALO = 3  # of these cells around the ground of a submap, so that its border is as if nothing had been cut off


@dataclass(frozen=True, eq=False)
class ObstacleCloud:
    """points   (N, 3) float32, world, meters: all points above the floor, and added points from their feet to the floor
    radii    (N,) float32, meters: half the width of the surface that a point represents
    confirmed  floor that the cloud shows; None if the cloud is missing or has fewer than 10 points
    """

    points: Float32
    radii: Float32
    confirmed: FloorSupport | None

    def near(self, places: NDArray[np.floating], reach: float) -> ObstacleCloud:
        """The obstacles near any of `places` (P, 2 or 3), as `Cloud.near`, and all confirmed floor."""
        kept = near_places(self.points, places, reach)
        return replace(self, points=self.points[kept], radii=self.radii[kept])


@dataclass(frozen=True)
class ObstacleConfig:
    """clearance  meters: surfaces higher above the floor are obstacles
    cover      half-width of a cloud point's square, in distances to its fourth neighbor
    sparse     a surface whose points are this many times as far apart as the median is glass or noise
    farthest   meters: obstacles farther from all cameras are left out
    """

    clearance: float = 0.05
    cover: float = 0.8
    sparse: float = 2.0
    farthest: float = 20.0


class BuildingObstacles:
    """The obstacles of a capture. The ground of a storey is divided among its floor surfaces: each place has that of
    the nearest frame. So every point is processed once, and not once for each submap that sees it."""

    def __init__(self, capture: Capture, surfaces: Sequence[FloorSurface], config: ObstacleConfig) -> None:
        """`surfaces` are those around each frame of the capture; frames of a submap have the same object."""
        self._cloud, self._positions, self._config = capture.cloud, capture.positions, config
        self._surfaces = list({id(s): s for s in surfaces}.values())
        index = {id(surface): i for i, surface in enumerate(self._surfaces)}
        self._owner = np.array([index[id(s)] for s in surfaces], np.int64)
        self._storey = storeys_of(self._positions).part
        self._ground: dict[int, _Ground] = {}
        self._found: dict[int, ObstacleCloud] = {}

    def near(self, members: Sequence[int], frames: Sequence[int]) -> ObstacleCloud:
        """The obstacles that the `frames` can see, on the storey of `members`, which have the same surface."""
        storey, places = int(self._storey[members[0]]), self._positions[list(frames)]
        surface, level = self._surfaces[self._owner[members[0]]], np.flatnonzero(self._storey == storey)
        if self._cloud is None:
            return split_obstacles(None, surface, self._config)
        if len(np.unique(self._owner[level])) == 1:
            cloud = flatten_floor(self._cloud.near(places, self._config.farthest), surface)
            return split_obstacles(cloud, surface, self._config)
        distance, _ = cKDTree(places[:, :2]).query(self._positions[level, :2])
        # A place that the frames can see is as close to the cameras of its own submap.
        owners = np.unique(self._owner[level[distance <= 2 * self._config.farthest]])
        return _joined([self._of_submap(storey, int(owner)).near(places, self._config.farthest) for owner in owners])

    def _of_submap(self, storey: int, owner: int) -> ObstacleCloud:
        """The obstacles on the ground of a submap."""
        import cv2

        if owner in self._found:
            return self._found[owner]
        assert self._cloud is not None
        if storey not in self._ground:
            level = np.flatnonzero(self._storey == storey)
            self._ground[storey] = _Ground.of(self._positions[level], self._owner[level], self._config.farthest)
        own = self._ground[storey].owner == owner
        wide = cv2.dilate(own.astype(np.uint8), np.ones((2 * _HALO + 1, 2 * _HALO + 1), np.uint8)) > 0
        surface, ground = self._surfaces[owner], self._ground[storey]
        cloud = flatten_floor(self._cloud.only(ground.contains(wide, self._cloud.points)), surface)
        found = split_obstacles(cloud, surface, self._config)
        kept = ground.contains(own, found.points)
        confirmed = found.confirmed
        if confirmed is not None:
            rows, columns = np.nonzero(confirmed.cells)
            centers = confirmed.origin + confirmed.spacing * (np.stack([columns, rows], axis=1) + 0.5)
            outside = ~ground.contains(own, centers)
            confirmed.cells[rows[outside], columns[outside]] = False
        self._found[owner] = ObstacleCloud(found.points[kept], found.radii[kept], confirmed)
        return self._found[owner]


@dataclass(frozen=True, eq=False)
class _Ground:
    """Which submap each cell of the ground belongs to: `owner` (rows, columns), -1 for none; `low` (2,) is the corner,
    meters."""

    owner: NDArray[np.int64]
    low: NDArray[np.float64]

    @staticmethod
    def of(positions: NDArray[np.float64], owners: NDArray[np.int64], reach: float) -> _Ground:
        """The ground within `reach` meters of cameras at `positions` (N, 3) with `owners` (N,)."""
        low = np.floor(positions[:, :2].min(axis=0) - reach) - 3.0
        columns, rows = grid_size(low, positions[:, :2].max(axis=0) + reach + 3.0, _SQUARE, "the cameras")
        x, y = (low[a] + _SQUARE * (np.arange(n) + 0.5) for a, n in enumerate((columns, rows)))
        # Some points that `Cloud.near` keeps are up to two meters farther.
        tree = cKDTree(positions[:, :2])
        nearest = tree.query(np.stack(np.meshgrid(x, y), axis=-1), distance_upper_bound=reach + 2.0)[1]
        return _Ground(np.append(owners, -1)[nearest], low)

    def contains(self, cells: NDArray[np.bool_], places: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(N,) bool: which `places` (N, 2 or 3) are in one of the `cells` (rows, columns) bool."""
        from nvsim.geometry.grid_kernels import look_up_cells

        found = np.empty(len(places), bool)
        look_up_cells(cells, float(self.low[0]), float(self.low[1]), _SQUARE, places, found)
        return found


def _joined(parts: Sequence[ObstacleCloud]) -> ObstacleCloud:
    """All obstacles and all confirmed floor of `parts`."""
    points, radii = np.concatenate([p.points for p in parts]), np.concatenate([p.radii for p in parts])
    grids = [p.confirmed for p in parts if p.confirmed is not None]
    if not grids:
        return ObstacleCloud(points, radii, None)
    low = np.min([g.origin for g in grids], axis=0)
    corners = [np.round((np.array(g.origin) - low) / _CELL).astype(int) for g in grids]
    columns, rows = np.max([at + g.cells.shape[::-1] for at, g in zip(corners, grids, strict=True)], axis=0)
    cells = np.zeros((rows, columns), bool)
    for (column, row), grid in zip(corners, grids, strict=True):
        height, width = grid.cells.shape
        cells[row : row + height, column : column + width] |= grid.cells
    return ObstacleCloud(points, radii, FloorSupport(cells, (float(low[0]), float(low[1])), _CELL))


def split_obstacles(cloud: Cloud | None, surface: FloorSurface, config: ObstacleConfig) -> ObstacleCloud:
    """Splits a cloud into obstacles above the floor and points that confirm floor. On stairs both limits are half a
    step higher."""
    nothing = ObstacleCloud(np.empty((0, 3), np.float32), np.empty(0, np.float32), None)
    if cloud is None or len(cloud.points) < 10:
        return nothing
    points = np.asarray(cloud.points, np.float32)
    above = points[:, 2] - surface.height_at(points[:, :2])
    clear = config.clearance + Stairs.of(surface).half_step(points)
    obstacles, height = points[above > clear], above[above > clear]
    on_floor = points[np.abs(above) <= clear]
    feet = _extend_to_floor(obstacles, height, on_floor, surface)
    everything = np.ascontiguousarray(np.concatenate([obstacles, feet]), np.float32)
    spacing = distance_to(everything, 4)
    # A surface with far fewer points than the rest is glass or noise: surfaces behind it are visible.
    around = _local_mean(everything, spacing)
    solid = around <= config.sparse * float(np.median(around)) if len(spacing) else np.empty(0, bool)
    radii = np.where(solid, np.clip(config.cover * spacing, 0.03, 0.2), 0.02).astype(np.float32)
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
