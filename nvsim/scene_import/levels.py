"""Find the storeys of an upright scene: floor heights, known floor, free floor, and places to start from."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.cells import grid_size
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.kernels import njit
from nvsim.scene_import.slab_cover import Grid, slab_cover
from nvsim.scene_import.surface_points import SurfacePoints
from nvsim.splats.types import Gaussians

APART = 1.8  # meters between two floors, at least
HEADROOM = (0.3, 1.7)  # meters above a floor that are free
CEILING = (1.9, 6.0)  # meters above a floor in which its ceiling is
SPACING = 0.05  # meters per cell of known floor
_VOXEL = 0.1  # meters
_LEVEL = np.cos(np.radians(25.0))  # least upward component of the normal of a horizontal surface
_BIN = 0.02  # meters
_LEAST_AREA, _LEAST_SHARE = 1.5, 0.08  # square meters of a floor, and share of the largest
_SLAB = 0.5  # meters between a ceiling and the floor above it, at most
_FEW, _FEW_SHARE = 3, 0.05  # places of a storey, and their share of all places
_AROUND = 0.12  # meters by which a floor may differ from the height of its storey
_NODES = 0.5  # meters between heights of a floor
_FLOOR, _BODY, _WALL = (-0.12, 0.08), (0.12, 1.5), (1.0, 1.9)  # slabs above the floor, meters
_COVERED, _BLOCKED = 0.5, 0.3
_BRIDGED = 1.0  # meters: widest half hole in a ceiling, such as a skylight
_ENCLOSED = 0.6  # share of directions in which a wall is, inside a building
_ROOFED = 0.6  # share of enclosed floor with a ceiling above; with less, the splats do not show the ceilings
_LEAST_FLOOR = 0.2  # share of the area under ceilings and between walls that a floor covers; tables and beds cover less
_ENCLOSED_ALONE = 0.85  # as _ENCLOSED, if the splats do not show the ceilings
_SEEN = 20.0  # meters to such a wall
_DIRECTIONS, _WALL_CELL = 24, 4  # cells of SPACING
_ROOM = 1.0  # square meters of the smallest free area
_CLEAR = 0.3  # meters from a place to start from to the nearest obstacle
_BETWEEN = 0.8  # meters between these places
_MOST_VOXELS = 120_000_000


@dataclass(frozen=True, eq=False)
class Level:
    """One storey.

    height   meters, world z
    surface  local floor heights
    grid     the cells of the arrays below, equal for all storeys
    known    (rows, columns) bool, floor that the Gaussians show inside the building
    free     (rows, columns) bool, known floor without obstacles above
    places   (P, 3) meters: floor places with the most free space around, first the most
    ceiling  meters between floor and ceiling, NaN if unknown
    """

    height: float
    surface: FloorSurface
    grid: Grid
    known: NDArray[np.bool_]
    free: NDArray[np.bool_]
    places: NDArray[np.float64]
    ceiling: float

    @property
    def area(self) -> float:
        """Known floor in square meters."""
        return float(self.known.sum()) * self.grid.spacing**2


@dataclass(frozen=True, eq=False)
class Storeys:
    """The storeys, lowest first, and why there is none: "floor" if no horizontal surface has room to stand above,
    "ceiling" if no such surface has a ceiling, "room" if no free floor is enclosed by walls. "" if there are storeys.
    """

    levels: tuple[Level, ...]
    missing: str = ""


@dataclass(frozen=True, eq=False)
class _Columns:
    """Occupied voxels: `counts` (X, Y, Z + 1) is the number of occupied voxels below each height."""

    counts: NDArray[np.int16]
    low: NDArray[np.float64]

    @staticmethod
    def of(points: NDArray[np.float64]) -> _Columns | None:
        low = points.min(axis=0) - _VOXEL
        shape = np.ceil((points.max(axis=0) - low) / _VOXEL).astype(np.int64) + 1
        if float(np.prod(shape.astype(np.float64))) > _MOST_VOXELS:
            return None
        full = np.zeros(shape, np.int16)
        full[tuple(np.floor((points - low) / _VOXEL).astype(np.int64).T)] = 1
        counts = np.zeros((shape[0], shape[1], shape[2] + 1), np.int16)
        np.cumsum(full, axis=2, out=counts[:, :, 1:])
        return _Columns(counts, low)

    def count_between(self, points: NDArray[np.float64], low: float, high: float) -> NDArray[np.int64]:
        """(N,) number of occupied voxels from `low` to `high` meters above points (N, 3)."""
        at = np.floor((points - self.low) / _VOXEL).astype(np.int64)
        top = self.counts.shape[2] - 1
        first, last = (np.clip(at[:, 2] + round(h / _VOXEL), 0, top) for h in (low, high))
        inside = self.counts[at[:, 0], at[:, 1]]
        rows = np.arange(len(at))
        return inside[rows, last].astype(np.int64) - inside[rows, first]


def horizontal(surface: SurfacePoints) -> NDArray[np.bool_]:
    """(N,) bool, whether the surface at each point is horizontal."""
    return np.asarray(np.abs(surface.normals[:, 2]) > _LEVEL)


def floor_heights(surface: SurfacePoints) -> tuple[list[float], str]:
    """Heights of the storeys' floors, ascending, meters; and why there is none, see `Storeys`."""
    columns = _Columns.of(surface.points) if len(surface.points) else None
    if columns is None:
        return [], "floor"
    level = surface.points[horizontal(surface)]
    standing = level[columns.count_between(level, *HEADROOM) <= 1]
    covered = standing[columns.count_between(standing, *CEILING) > 0]
    heights = _peaks(covered)
    if heights:
        return heights, ""
    return [], "ceiling" if _peaks(standing) else "floor"


def standing_points(surface: SurfacePoints) -> NDArray[np.float64]:
    """(N, 3) points of horizontal surfaces with room to stand above."""
    columns = _Columns.of(surface.points) if len(surface.points) else None
    if columns is None:
        return np.zeros((0, 3))
    level = surface.points[horizontal(surface)]
    return np.asarray(level[columns.count_between(level, *HEADROOM) <= 1])


def _peaks(points: NDArray[np.float64]) -> list[float]:
    """Heights with much floor, each at least APART from larger ones, ascending."""
    if not len(points):
        return []
    cells = np.unique(np.floor(points / (_VOXEL, _VOXEL, _BIN)).astype(np.int64), axis=0)
    start = int(cells[:, 2].min()) - 5
    area = np.bincount(cells[:, 2] - start, minlength=11).astype(np.float64) * _VOXEL**2
    area = np.convolve(area, np.exp(-0.5 * (np.arange(-5, 6) / 2) ** 2), "same")
    largest, found = area.max(), list[float]()
    for k in np.argsort(-area, kind="stable"):
        if area[k] < max(_LEAST_AREA, _LEAST_SHARE * largest):
            break
        above = area[k + round(0.1 / _BIN) : k + round(_SLAB / _BIN)]
        if len(above) and above.max() > 0.5 * area[k]:  # this is the ceiling below a floor
            k += round(0.1 / _BIN) + int(above.argmax())
        z = (start + k + 0.5) * _BIN
        if all(abs(z - other) >= APART for other in found):
            near = points[np.abs(points[:, 2] - z) < 0.06, 2]
            found.append(float(np.median(near)))
    return sorted(found)


def find_storeys(gaussians: Gaussians, surface: SurfacePoints) -> Storeys:
    """The storeys of a scene.

    gaussians  z up, meters
    surface    points of these Gaussians

    Raises InputError if the scene is too large for a grid.
    """
    heights, missing = floor_heights(surface)
    if missing:
        return Storeys((), missing)
    level = surface.points[horizontal(surface)]
    low, high = (np.percentile(surface.points[:, :2], q, axis=0) + s for q, s in ((0.2, -0.5), (99.8, 0.5)))
    columns, rows = grid_size(low, high, _NODES, "the Gaussians")
    nodes = (rows + 2, columns + 2)
    found = []
    for height, above in zip(heights, ceiling_distances(heights), strict=True):
        near = level[np.abs(level[:, 2] - height) < _AROUND]
        floor = _surface(near, height, (float(low[0]), float(low[1])), nodes)
        tops = level[(level[:, 2] > height + CEILING[0]) & (level[:, 2] < height + above + 0.1)]
        found.append(_level(gaussians, floor, height, above, _peaks(tops)))
    few = max(_FEW, _FEW_SHARE * sum(len(one.places) for one in found)) if len(found) > 1 else 1
    levels = tuple(one for one in found if len(one.places) >= few)
    return Storeys(levels, "" if levels else "room")


def ceiling_distances(heights: list[float]) -> list[float]:
    """The greatest distance in meters from each of these floors, ascending, to its ceiling."""
    gaps = [upper - lower - 0.15 for lower, upper in itertools.pairwise(heights)]
    return [min(gap, CEILING[1]) for gap in (*gaps, CEILING[1])]


def known_floor(
    gaussians: Gaussians, surface: FloorSurface, height: float, above: float
) -> tuple[Grid, NDArray[np.bool_], NDArray[np.bool_]]:
    """The grid of a storey, its known floor and its free floor, both (rows, columns) bool, see `Level`.

    height  of the storey's floor, meters, world z
    above   meters from the floor to the highest possible ceiling
    """
    from scipy import ndimage

    rows, columns = ((n - 1) * round(_NODES / SPACING) for n in surface.heights.shape)
    grid = Grid(surface.origin, SPACING, (rows, columns))
    floor = surface.height_at(grid.centers()).astype(np.float64)
    slabs = [_FLOOR, _BODY, _WALL, (CEILING[0], above)]
    near = (gaussians.means[:, 2] > height - 2.0) & (gaussians.means[:, 2] < height + above + 1.0)
    cover, body, wall, ceiling = slab_cover(_select_gaussians(gaussians, near), grid, floor, slabs)
    roofed = ndimage.binary_closing(np.pad(ceiling > _COVERED, 40), _disc(round(_BRIDGED / SPACING / 4)), iterations=4)
    known = ndimage.binary_closing(np.pad(cover > _COVERED, 40), _disc(3))[40:-40, 40:-40]
    enclosure, roofed = _enclosure(wall > _COVERED), roofed[40:-40, 40:-40]
    inside = roofed & (enclosure >= _ENCLOSED)
    if (known & inside).sum() < _LEAST_FLOOR * inside.sum():
        known[:] = False
    enclosed = known & (enclosure >= _ENCLOSED)
    if (enclosed & roofed).sum() >= _ROOFED * enclosed.sum():
        known = enclosed & roofed
    else:
        known &= enclosure >= _ENCLOSED_ALONE
    known = ndimage.binary_opening(known, _disc(2))
    return grid, known, known & (body < _BLOCKED)


def _level(gaussians: Gaussians, surface: FloorSurface, height: float, above: float, tops: list[float]) -> Level:
    """The storey with its floor at `height`; `tops` are the heights of possible ceilings."""
    from scipy import ndimage

    grid, known, free = known_floor(gaussians, surface, height, above)
    clearance = np.asarray(ndimage.distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1]) * SPACING
    areas, count = ndimage.label(clearance > _CLEAR - SPACING)
    sizes = ndimage.sum_labels(np.ones_like(clearance), areas, np.arange(count + 1)) * SPACING**2
    wide = (areas > 0) & (sizes[areas] >= _ROOM)
    places = _places(np.where(wide, clearance, 0.0), grid)
    z = surface.height_at(places) if len(places) else np.zeros(0)
    ceiling = tops[0] - height if tops else float("nan")
    return Level(height, surface, grid, known, free, np.column_stack([places, z]), ceiling)


def _select_gaussians(g: Gaussians, rows: NDArray[np.bool_]) -> Gaussians:
    return Gaussians(g.means[rows], g.log_scales[rows], g.quats[rows], g.opacity_logits[rows], g.sh[rows, :1])


def _disc(radius: int) -> NDArray[np.bool_]:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.asarray(x * x + y * y <= radius * radius + 0.5)


def _surface(
    points: NDArray[np.float64], height: float, low: tuple[float, float], shape: tuple[int, int]
) -> FloorSurface:
    """The medians of the heights of floor points (N, 3) around nodes, and `height` away from all points."""
    from scipy import ndimage

    rows, columns = shape
    cell = np.floor((points[:, :2] - low) / _NODES + 0.5).astype(np.int64)
    inside = ((cell >= 0) & (cell < (columns, rows))).all(axis=1)
    number, z = (cell[:, 1] * columns + cell[:, 0])[inside], points[inside, 2]
    order = np.lexsort((z, number))
    number, z = number[order], z[order]
    nodes, first, counts = np.unique(number, return_index=True, return_counts=True)
    heights = np.full(rows * columns, np.nan)
    many = counts >= 8
    heights[nodes[many]] = z[(first + counts // 2)[many]]
    table = heights.reshape(rows, columns)
    empty = np.isnan(table)
    if empty.all():
        table = np.full_like(table, height)
    elif empty.any():
        nearest = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
        table = table[tuple(nearest)]
    smooth = ndimage.median_filter(table, size=3, mode="nearest")
    return FloorSurface(smooth.astype(np.float32), low, _NODES)


def _places(clearance: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """(P, 2) meters: cells with clearance, at least _BETWEEN apart, the widest first."""
    rows, columns = np.nonzero(clearance >= _CLEAR)
    order = np.lexsort((columns, rows, -np.round(clearance[rows, columns], 3)))
    xy = np.asarray(grid.low) + (np.stack([columns, rows], axis=1)[order] + 0.5) * grid.spacing
    block = np.floor(xy / (0.25 * _BETWEEN)).astype(np.int64)
    xy = xy[np.sort(np.unique(block, axis=0, return_index=True)[1])]
    found = np.zeros((0, 2))
    left = xy
    while len(left):
        found = np.vstack([found, left[:1]])
        left = left[np.hypot(*(left - left[0]).T) >= _BETWEEN]
    return found


def _enclosure(walls: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(rows, columns) share of directions in which each cell has a wall within _SEEN meters."""
    rows, columns = (-(-n // _WALL_CELL) for n in walls.shape)
    padded = np.pad(walls, ((0, rows * _WALL_CELL - walls.shape[0]), (0, columns * _WALL_CELL - walls.shape[1])))
    coarse = np.asarray(padded.reshape(rows, _WALL_CELL, columns, _WALL_CELL).any(axis=(1, 3)), np.bool_)
    found = np.zeros((rows, columns), np.float32)
    _count_walls(coarse, _DIRECTIONS, _SEEN / (_WALL_CELL * SPACING), found)
    fine = np.repeat(np.repeat(found, _WALL_CELL, axis=0), _WALL_CELL, axis=1)
    return np.asarray(fine[: walls.shape[0], : walls.shape[1]])


@njit(cache=True)
def _count_walls(walls: NDArray[np.bool_], directions: int, reach: float, found: NDArray[np.float32]) -> None:
    rows, columns = walls.shape
    for k in range(directions):
        dx, dy = np.cos(2 * np.pi * k / directions), np.sin(2 * np.pi * k / directions)
        for row in range(rows):
            for column in range(columns):
                for step in range(1, int(reach) + 1):
                    r, c = int(np.floor(row + 0.5 + step * dy)), int(np.floor(column + 0.5 + step * dx))
                    if r < 0 or c < 0 or r >= rows or c >= columns:
                        break
                    if walls[r, c]:
                        found[row, column] += np.float32(1.0 / directions)
                        break
