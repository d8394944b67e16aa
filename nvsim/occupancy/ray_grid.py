"""Occupancy by ray casting, as in OctoMap (Hornung et al. 2013).

Every ray frees the voxels that it passes and occupies the voxel in which it ends. Log-odds are clamped. A scan updates
a voxel once, and a voxel that one of its rays hits is not freed by its other rays.

Only voxels in a band over the local floor are stored. Ramps are therefore not obstacles, and memory grows only with the
ground area.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.cells import grid_size
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.occupancy import ray_kernels
from nvsim.occupancy.types import FREE, OCCUPIED, UNKNOWN, Heights, OccupancyMap

Float64 = NDArray[np.float64]
_MOST_VOXELS = 400_000_000  # 2 GB if all are touched; untouched voxels use no memory
_FOOT = 0.3  # meters above the lower height, within which a ray must pass a column to make it free
_GAP = 0.2  # meters
_SPECK = 0.03  # square meters: smaller obstacles that do not reach the foot of the band are sensor noise
_HOLES = 0.1  # meters around a point: points at this density occlude the points behind them
_SEEING = 24  # nearest sensor positions that are tested for a point of unknown sensor position
_SEEN_FROM = 3  # positions from which such a point counts as seen; overlaps the rays of neighboring positions
_CHUNK = 1 << 18  # rays


def _log_odds(probability: float) -> float:
    return math.log(probability / (1 - probability))


ODDS = np.array([_log_odds(p) for p in (0.7, 0.4, 0.1192, 0.971)], np.float32)
"""OctoMap's defaults: log-odds of a hit and of a pass, and the lower and upper clamping limits."""


class RayGrid:
    """The voxels over a part of the ground, with the evidence of scans.

    low, high    (2,) corners of that part, meters, world
    resolution   meters, edge of a voxel; voxels are aligned with the world origin, as in OctoMap
    floor        the floor surface under the band; each column uses the height at its center
    heights      of the band; a voxel belongs to it if its center does
    top          meters over the floor up to which voxels are stored, if higher than the band; these voxels are not
                 obstacles, but occlude objects behind them

    Raises InputError if there are too many voxels for common amounts of memory.
    """

    def __init__(
        self,
        low: Float64,
        high: Float64,
        resolution: float,
        floor: FloorSurface,
        heights: Heights | None = None,
        top: float = 0.0,
    ) -> None:
        heights = heights or Heights()
        if not 1e-3 <= resolution <= 10:
            raise InputError(f"Cells of {resolution:g} m are not valid; give --resolution 0.001 to 10 meters.")
        self.resolution = resolution
        self._corner = np.floor(np.asarray(low, np.float64) / resolution)
        columns, rows = grid_size(self._corner * resolution, np.asarray(high), resolution, "the rays")
        columns, rows = max(columns, 1), max(rows, 1)
        self.band = max(1, round((heights.to_height - heights.from_height) / resolution))
        self.layers = max(self.band, math.ceil((top - heights.from_height) / resolution))
        if rows * columns * self.layers > _MOST_VOXELS:
            raise InputError(
                f"A map of {columns * resolution:.0f} x {rows * resolution:.0f} m up to {heights.to_height:g} m has "
                f"too many cells of {resolution:g} m for the memory; give a larger --resolution in meters."
            )
        empty = OccupancyMap(np.full((rows, columns), UNKNOWN, np.uint8), resolution, self._origin)
        lowest = (floor.height_at(empty.centers()).astype(np.float64) + heights.from_height) / resolution
        self._base = np.ceil(lowest - 0.5 - 1e-6).astype(np.int32)
        self._levels = int(self._base.min()), int(self._base.max()) + self.layers
        self._log_odds = np.zeros(rows * columns * self.layers, np.float32)
        self._marks = np.zeros(len(self._log_odds), np.uint8)
        self._touched = np.empty(1 << 16, np.int64)
        self._stepped = np.zeros(1, np.int64)

    @property
    def _origin(self) -> tuple[float, float]:
        return float(self._corner[0] * self.resolution), float(self._corner[1] * self.resolution)

    @property
    def steps(self) -> int:
        """Number of voxels that all rays have passed so far."""
        return int(self._stepped[0])

    def add(self, points: NDArray[np.floating], origin: NDArray[np.floating], reach: float = math.inf) -> None:
        """Add one scan: rays to `points` (N, 3) from `origin`, (3,) or (N, 3), meters, world. A ray longer than `reach`
        meters frees the first `reach` meters and hits no voxel."""
        ends = np.asarray(points, np.float64).reshape(-1, 3)
        start = np.broadcast_to(np.asarray(origin, np.float64), ends.shape)
        length = np.linalg.norm(ends - start, axis=1)
        far = length > reach
        count = self._hit(self._in_voxels(ends[~far]))
        if far.any():
            ends = ends.copy()
            ends[far] = start[far] + (ends - start)[far] * (reach / length[far])[:, None]
        self._apply_marks(self._pass(start, ends, count))

    def add_merged(self, points: NDArray[np.floating], places: Float64, reach: float = math.inf) -> int:
        """Add one merged scan, whose points have no known sensor position.

        Each of `points` (N, 3) counts as seen from the nearest of the sensor `places` (M, 3), meters, world, at most
        `reach` meters away, with no other point in between. Returns the number of points that no place sees. These are
        hits that free no voxels."""
        from scipy.spatial import cKDTree

        ends = np.asarray(points, np.float64).reshape(-1, 3)
        count = self._hit(self._in_voxels(ends))
        width = math.ceil(_HOLES / self.resolution)
        walls = np.zeros(len(self._marks), bool)
        ray_kernels.dilate_walls(self._touched, count, width, self._base, self.layers, walls)
        tree, in_voxels = cKDTree(places), self._in_voxels(places)
        hidden = 0
        for i in range(0, len(ends), _CHUNK):
            part = ends[i : i + _CHUNK]
            nearest = tree.query(part, k=range(1, min(_SEEING, len(places)) + 1), distance_upper_bound=reach)[1]
            seen_from = np.empty((len(part), _SEEN_FROM), np.int64)
            ray_kernels.find_first_visible(
                in_voxels, nearest, self._in_voxels(part), self._base, self.layers, walls, width + 1, seen_from
            )
            hidden += int(np.count_nonzero(seen_from[:, 0] < 0))
            for chosen in seen_from.T:
                seen = chosen >= 0
                count = self._pass(places[chosen[seen]], part[seen], count)
        self._apply_marks(count)
        return hidden

    def flat(self) -> OccupancyMap:
        """The 2D map of the voxels, cropped to the known cells.

        A column is occupied if a voxel of its band is occupied. It is free if no voxel is occupied and a ray passed at
        its foot, within 0.3 m of the lower height. Otherwise it is unknown.

        Floating specks are also free: a few connected cells, at all of whose feet rays passed. A gap of at most 0.2 m
        between occupied cells is unknown, because scans leave such holes in tables and sofas.
        """
        from scipy.ndimage import binary_closing, find_objects, label, sum_labels

        hit, open_below = np.empty((2, *self._base.shape), bool)
        foot = max(1, round(_FOOT / self.resolution))
        ray_kernels.project_down(self._log_odds, self.layers, self.band, foot, hit, open_below)
        parts, count = label(hit, np.ones((3, 3)))
        every = np.arange(1, count + 1)
        standing = sum_labels(~open_below, parts, every) > 0
        large = np.bincount(parts.ravel(), minlength=count + 1)[1:] * self.resolution**2 >= _SPECK
        hit &= np.append(False, standing | large)[parts]
        half = round(_GAP / 2 / self.resolution)
        closed = binary_closing(np.pad(hit, half), np.ones((2 * half + 1,) * 2))[half:, half:][
            : len(hit), : hit.shape[1]
        ]
        cells = np.where(hit, OCCUPIED, np.where(open_below & ~closed, FREE, UNKNOWN))
        known = find_objects((cells != UNKNOWN).astype(np.uint8))
        rows, columns = known[0] if known else (slice(0, 1), slice(0, 1))
        x, y = ((self._corner + (columns.start, rows.start)) * self.resolution).tolist()
        return OccupancyMap(cells[rows, columns].copy(), self.resolution, (x, y))

    def _in_voxels(self, points: Float64) -> Float64:
        scaled = np.asarray(points, np.float64) * (1 / self.resolution)
        scaled[:, :2] -= self._corner
        return np.ascontiguousarray(scaled)

    def _hit(self, ends: Float64) -> int:
        self._make_room(len(ends))
        return ray_kernels.mark_hits(ends, self._base, self.layers, self._marks, self._touched, 0)

    def _pass(self, start: Float64, ends: Float64, count: int) -> int:
        for i in range(0, len(ends), _CHUNK):
            first, some = 0, slice(i, i + _CHUNK)
            a, b = self._in_voxels(start[some]), self._in_voxels(ends[some])
            while True:
                first, count = ray_kernels.mark_passed(
                    a,
                    b,
                    first,
                    self._base,
                    self.layers,
                    *self._levels,
                    self._marks,
                    self._touched,
                    count,
                    self._stepped,
                )
                if first == len(b):
                    break
                self._make_room(2 * len(self._touched))
        return count

    def _make_room(self, most: int) -> None:
        """Grow the list of voxels to `most` entries. Its content is kept."""
        if most > len(self._touched):
            grown = np.empty(most, np.int64)
            grown[: len(self._touched)] = self._touched
            self._touched = grown

    def _apply_marks(self, count: int) -> None:
        ray_kernels.update_log_odds(self._marks, self._touched, count, self._log_odds, ODDS)
