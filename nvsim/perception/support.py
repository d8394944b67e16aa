"""Known floor: the grid of floor that masks or the cloud show. The map builder uses only this floor. Rendered views are
also empty beyond a wall, inside furniture, and in a room without frames; only known floor tells these from free
space."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Cloud
from nvsim.errors import InputError
from nvsim.files.stored_arrays import read_arrays, write_arrays
from nvsim.geometry.camera import Camera
from nvsim.geometry.cells import grid_size
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.sampling import STRIDE, places_between
from nvsim.perception.stairs import Stairs

Mask = NDArray[np.bool_]
_USUAL = 0.25  # meters: greatest difference between camera heights of one kind
_MANY = 0.25  # share of the most frequent camera height
_STEP = 0.5  # meters that a person crosses in one step
_APART = 0.05  # meters between the tested places of a trajectory
_BLOCK = 1 << 20  # points of a cloud that are processed at the same time, about 150 MB


@dataclass(frozen=True, eq=False)
class FloorSupport:
    """cells    (rows, columns) bool, True for floor; row follows y, column x
    origin   (x, y) meters of the lower corner of cell [0, 0]
    spacing  meters per cell
    blocked  (rows, columns) bool, True for obstacles by depth from images; None if unknown
    thin     (rows, columns) bool, True for thin obstacles, which stay even if the trajectory crosses them; None if
             unknown
    """

    cells: Mask
    origin: tuple[float, float]
    spacing: float
    blocked: Mask | None = None
    thin: Mask | None = None

    def is_supported(self, xy: NDArray[np.floating]) -> Mask:
        """(...) bool: whether world points (..., 2), meters, are on known floor; False outside the grid. The z of
        points (..., 3) is ignored, because there is one floor."""
        from nvsim.geometry.grid_kernels import look_up_cells

        xy = np.asarray(xy)
        places = np.ascontiguousarray(xy.reshape(-1, xy.shape[-1]), np.float64)
        found = np.empty(len(places), bool)
        look_up_cells(self.cells, float(self.origin[0]), float(self.origin[1]), float(self.spacing), places, found)
        return found.reshape(xy.shape[:-1])

    def save(self, path: Path) -> None:
        """Writes an .npz file. Raises InputError if it cannot be written."""
        origin, spacing = np.array(self.origin), np.array(self.spacing)
        write_arrays(path, {"cells": self.cells, "origin": origin, "spacing": spacing})

    def with_trajectory_floor(self, positions: NDArray[np.floating], radius: float = 0.4) -> FloorSupport:
        """Adds the floor under the trajectory, which the camera may never have seen. This is the ground within `radius`
        meters of its positions (N, 2 or 3), given in order of time.

        Obstacles are not added, because a camera can be held over a table. An obstacle counts as floor if the
        trajectory crosses it in one step, such as a wall wrongly continued across a doorway. Thin obstacles always
        stay."""
        if not len(positions):
            return FloorSupport(self.cells if self.thin is None else self.cells & ~self.thin, self.origin, self.spacing)
        low = np.minimum(self.origin, positions[:, :2].min(axis=0) - radius - self.spacing)
        offset = np.ceil((np.array(self.origin) - low) / self.spacing).astype(int)
        origin = np.array(self.origin) - offset * self.spacing
        rows, columns = self.cells.shape
        grid_size(
            low, np.maximum(low, positions[:, :2].max(axis=0)) + radius, self.spacing, "the positions of the cameras"
        )
        top = np.ceil((positions[:, :2].max(axis=0) + radius - origin) / self.spacing).astype(int) + 1
        cells = np.zeros((max(rows + offset[1], top[1]), max(columns + offset[0], top[0])), bool)
        here = np.s_[offset[1] : offset[1] + rows, offset[0] : offset[0] + columns]
        cells[here] = self.cells
        corner = (float(origin[0]), float(origin[1]))
        _fill_discs(cells, (positions[:, :2] - origin) / self.spacing - 0.5, radius / self.spacing)
        if self.blocked is not None:
            cells[here] &= self.cells | ~self.blocked
            through = _unsupported_places(positions[:, :2], FloorSupport(cells, corner, self.spacing))
            _fill_discs(cells, (through - origin) / self.spacing - 0.5, radius / self.spacing)
        if self.thin is not None:
            cells[here] &= ~self.thin
        return FloorSupport(cells, corner, self.spacing)

    @staticmethod
    def load(path: Path) -> FloorSupport:
        """Reads the file that `save` wrote. Raises InputError if it is missing or has other content."""
        again = "run `nvsim floors --project` again"
        arrays = read_arrays(
            path, "a floor support", {"cells": ("bui", 2), "origin": ("fi", 1), "spacing": ("fi", 0)}, again
        )
        cells, origin, spacing = arrays["cells"].astype(bool), arrays["origin"], float(arrays["spacing"])
        if not cells.size or origin.shape != (2,) or not np.isfinite([*origin, spacing]).all() or spacing <= 0:
            raise InputError(f"The floor support {path} cannot be read (its values are not valid); {again}.")
        return FloorSupport(cells, (float(origin[0]), float(origin[1])), spacing)


def _fill_discs(cells: Mask, centers: NDArray[np.floating], reach: float) -> None:
    """Sets the cells within `reach` of `centers` (N, 2), which are column and row; all in cells."""
    y, x = np.ogrid[: cells.shape[0], : cells.shape[1]]
    for column, row in np.unique(np.round(centers, 1), axis=0):
        r0, r1 = max(0, int(row - reach)), int(row + reach) + 2
        c0, c1 = max(0, int(column - reach)), int(column + reach) + 2
        cells[r0:r1, c0:c1] |= (y[r0:r1] - row) ** 2 + (x[:, c0:c1] - column) ** 2 <= reach**2


def _unsupported_places(positions: NDArray[np.floating], support: FloorSupport) -> NDArray[np.float64]:
    """(K, 2) unsupported places on a trajectory over positions (N, 2), meters, that it crossed in one step between
    supported floor."""
    places = places_between(positions, _APART, STRIDE)
    far = np.linalg.norm(np.diff(places, axis=0), axis=1)
    known = support.is_supported(places)
    found = np.zeros(len(places), bool)
    starts = np.flatnonzero(known[:-1] & ~known[1:])
    for start in starts:
        end = start + 1 + int(np.argmax(known[start + 1 :]))
        gaps = far[start:end]
        if known[end] and gaps.sum() <= _STEP and gaps.max() <= STRIDE:
            found[start + 1 : end] = True
    return places[found]


@dataclass(frozen=True)
class SupportConfig:
    """Lengths in meters.

    spacing    edge of a cell
    distance   a mask counts only for floor this close to its camera, because a pixel covers too much floor farther away
    tolerance  a cloud point this close to the floor height supports the floor; on stairs, half a step more
    guesses    number of points from depth of images that count as one point, because single ones are often wrong
    low, high  cloud points between these heights above the floor are obstacles
    guessed    added to `low` for points from depth of images: they wrongly continue walls across the foot of open
               doors, which no image sees through close to the floor
    standing   number of such points that make a cell an obstacle; masks cannot overrule it, because they see through
               glass
    views      least number of masks that show floor in a cell without support by the cloud
    share      least share of the frames that see the cell and show floor; an object can occlude it in the others
    """

    spacing: float = 0.08
    distance: float = 6.0
    tolerance: float = 0.04
    guesses: int = 7
    low: float = 0.10
    high: float = 1.5
    guessed: float = 0.015
    standing: int = 3
    views: int = 2
    share: float = 0.3


def positions_at_common_heights(positions: NDArray[np.floating], surface: FloorSurface) -> NDArray[np.floating]:
    """The camera positions (N, 3), meters, whose height above the floor is common among all positions; there can be two
    such heights. At other heights the camera was held over a table or raised, so the person was not directly below it.
    Never empty if there are positions."""
    above = positions[:, 2] - surface.height_at(positions[:, :2])
    order = np.sort(above)
    alike = np.searchsorted(order, above + _USUAL, side="right") - np.searchsorted(order, above - _USUAL)
    return positions[alike >= _MANY * alike.max(initial=0)]


def observe(
    cameras: Iterable[Camera],
    masks: Iterable[Mask],
    surface: FloorSurface,
    cloud: Cloud | None,
    config: SupportConfig | None = None,
    raised: NDArray[np.floating] | None = None,
    usable: Iterable[Mask | None] | None = None,
) -> FloorSupport:
    """The floor that the masks or the cloud support. `masks` has one (H, W) bool per camera, in order.

    Every mask is projected onto the floor surface. A cell is supported if at least `views` frames, and a share `share`
    of those that see it, show floor. A cell with cloud points at floor height is supported too, and so is a cell
    between supported cells. Cells with obstacles in a dense cloud are not supported. Cells around the places `raised`
    (K, 2), meters, of thin obstacles are not supported either, except on stairs, which are full of edges.

    `masks` is read one by one, so it can load them lazily. So is `usable`, each (h, w) bool or None for all pixels; a
    False pixel shows neither floor nor other surfaces. Raises ValueError if their number differs from that of cameras.
    """
    import cv2

    config = config or SupportConfig()
    views = list(cameras)
    places = np.array([c.position[:2] for c in views]).reshape(-1, 2)
    corners = [places - config.distance, places + config.distance]
    for points, _ in _near_points(cloud, places, config):
        corners.append(np.stack([points[:, :2].min(axis=0), points[:, :2].max(axis=0)]))
    everything = np.concatenate(corners)
    low = everything.min(axis=0) if len(everything) else np.zeros(2)
    high = everything.max(axis=0) if len(everything) else np.ones(2)
    origin = np.floor(low / config.spacing) * config.spacing
    columns, rows = (side + 1 for side in grid_size(origin, high, config.spacing, "the cameras"))

    def cell(xy: NDArray[np.floating]) -> NDArray[np.int64]:
        index = np.floor((xy - origin) / config.spacing).astype(np.int64)
        flat: NDArray[np.int64] = index[..., 1] * columns + index[..., 0]
        return flat

    x = origin[0] + (np.arange(columns) + 0.5) * config.spacing
    y = origin[1] + (np.arange(rows) + 0.5) * config.spacing
    centers = np.stack(np.meshgrid(x, y), axis=-1)
    ground = np.dstack([centers, surface.height_at(centers)])
    as_floor: NDArray[np.int32] = np.zeros((rows, columns), np.int32)
    as_other: NDArray[np.int32] = np.zeros((rows, columns), np.int32)
    reach = int(np.ceil(config.distance / config.spacing))
    counted = [None] * len(views) if usable is None else usable
    for camera, mask, counts in zip(views, masks, counted, strict=True):
        # Cells are projected to pixels, not pixels to cells: far away a pixel is wider than a cell.
        row, column = np.floor((camera.position[[1, 0]] - origin[[1, 0]]) / config.spacing).astype(int)
        window = np.s_[max(row - reach, 0) : row + reach + 1, max(column - reach, 0) : column + reach + 1]
        near = ground[window]
        pixels, depth = camera.project(near)
        height, width = mask.shape
        scale = np.array([width / camera.intrinsics.width, height / camera.intrinsics.height])
        u, v = np.moveaxis(np.floor(np.clip(pixels * scale, -1, 1e6)).astype(np.int64), -1, 0)
        within = np.sum((near[..., :2] - camera.position[:2]) ** 2, axis=-1) < config.distance**2
        framed = (depth > 0.05) & (u >= 0) & (u < width) & (v >= 0) & (v < height) & within
        floor = mask[v.clip(0, height - 1), u.clip(0, width - 1)]
        if counts is not None:
            if counts.shape != mask.shape:
                sized = cv2.resize(counts.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
                counts = np.asarray(sized > 0)
            framed &= counts[v.clip(0, height - 1), u.clip(0, width - 1)]
        as_floor[window] += framed & floor
        as_other[window] += framed & ~floor
    as_floor, as_other = as_floor.reshape(-1), as_other.reshape(-1)
    standing, blocked, thin = (np.zeros(rows * columns, bool) for _ in range(3))
    supported = (as_floor >= config.views) & (as_floor >= config.share * (as_floor + as_other))
    stairs, shown, obstacles, guesses = Stairs.of(surface), *np.zeros((3, rows * columns))
    for points, guessed in _near_points(cloud, places, config):
        above = points[:, 2] - surface.height_at(points[:, :2])
        index, half_step = cell(points[:, :2]), stairs.half_step(points)
        level = np.abs(above) <= config.tolerance + half_step
        say = np.where(guessed, 1 / config.guesses, 1.0)
        shown += np.bincount(index[level], say[level], minlength=rows * columns)
        low_end = config.low + half_step + np.where(guessed, config.guessed, 0.0)
        high = (above > low_end) & (above < config.high)
        obstacles += np.bincount(index[high], minlength=rows * columns)
        guesses += np.bincount(index[high & guessed], minlength=rows * columns)
    supported |= shown > 1 - 1e-9
    if cloud is not None and cloud.is_dense:
        standing, blocked = obstacles >= config.standing, guesses >= config.standing
    if raised is not None:
        off_stairs = raised[stairs.half_step(raised) == 0]
        # Wide enough that no row of a corridor's cells misses the obstacle.
        sides = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * config.spacing / 2
        around = (off_stairs[:, None] + sides).reshape(-1, 2)
        inside = ((around >= origin) & (around < origin + np.array([columns, rows]) * config.spacing)).all(axis=1)
        standing[cell(around[inside])] = thin[cell(around[inside])] = True
    grid = supported.reshape(rows, columns).astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    closed = (cv2.morphologyEx(grid, cv2.MORPH_CLOSE, cross) > 0) & ~standing.reshape(rows, columns)
    corner, shape = (float(origin[0]), float(origin[1])), (rows, columns)
    return FloorSupport(closed, corner, config.spacing, blocked.reshape(shape), thin.reshape(shape))


def _near_points(
    cloud: Cloud | None, places: NDArray[np.floating], config: SupportConfig
) -> Iterator[tuple[NDArray[np.float64], Mask]]:
    """The points (M, 3) of `cloud` near the cameras at `places` (N, 2), or all without cameras, in blocks that are not
    empty, and whether each is from depth of images (M,)."""
    if cloud is None:
        return
    low, high = (places.min(axis=0), places.max(axis=0)) if len(places) else (-np.inf, np.inf)
    low, high = low - 2 * config.distance, high + 2 * config.distance
    guessed = cloud.is_estimated
    for start in range(0, len(cloud.points), _BLOCK):
        points = np.asarray(cloud.points[start : start + _BLOCK], np.float64)
        around = ((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1)
        if around.any():
            yield points[around], guessed[start : start + _BLOCK][around]
