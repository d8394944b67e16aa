"""Fuse depth maps to one point cloud: points are averaged in cells."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.neighbourhood import axes_of

_EMPTY = -1
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)  # 2^64 / golden ratio: spreads neighboring keys over the table (Knuth)


@dataclass(frozen=True, eq=False)
class FusedCloud:
    """points   (N, 3) float32, meters, world
    colors   (N, 3) uint8 RGB
    normals  (N, 3) float32, unit, toward the cameras
    views    (N,) uint16, number of observations of the point
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    normals: NDArray[np.float32]
    views: NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """points   (N, 3) float32, meters, world
    eyes     (N, 3) float32, meters, world: mean position of the cameras that saw the point
    say      (N,) float32, 1 / meters squared: summed inverse variance of the observations
    """

    points: NDArray[np.float32]
    eyes: NDArray[np.float32]
    say: NDArray[np.float32]


class Fusion:
    """Accumulates points in cells of `voxel` meters. The cells are in an open hash table that grows."""

    def __init__(self, voxel: float) -> None:
        self.voxel = voxel
        self._keys = np.full(1 << 16, _EMPTY, np.int64)
        self._sums = np.zeros((1 << 16, 11), np.float64)
        self._filled = 0

    def add(
        self, camera: Camera, inverse: NDArray[np.float32], weight: NDArray[np.float32], image: NDArray[np.uint8]
    ) -> None:
        """Add the points of a map `inverse` (H, W) float32 of inverse depth, 1 / meters, 0 where unknown.

        `weight` (H, W) float32 is its inverse variance, meters squared; `image` (H, W, 3) uint8 RGB gives the
        colors."""
        new = int(np.count_nonzero(inverse > 0))
        while 2 * (self._filled + new) > len(self._keys):
            keys, sums = self._keys, self._sums
            self._keys = np.full(2 * len(keys), _EMPTY, np.int64)
            self._sums = np.zeros((2 * len(keys), 11), np.float64)
            used = keys != _EMPTY
            _insert(keys[used], sums[used], self._keys, self._sums)
        k = camera.intrinsics
        lens = np.array([k.fx, k.fy, k.cx, k.cy])
        pose = np.ascontiguousarray(camera.camera_to_world[:3], np.float64)
        self._filled += _add(lens, pose, inverse, weight, image, self.voxel, self._keys, self._sums)

    def seen_points(self, seen: int) -> SeenPoints:
        """The weighted mean points of the cells with at least `seen` observations and a positive weight."""
        sums = self._cells(seen)
        say = sums[:, 9:10]
        points, eyes = (sums[:, :3] / say).astype(np.float32), (sums[:, 6:9] / say).astype(np.float32)
        return SeenPoints(points, eyes, say[:, 0].astype(np.float32))

    def cloud(
        self, seen: int, standing: Callable[[NDArray[np.float32]], NDArray[np.bool_]] | None = None
    ) -> FusedCloud:
        """The point cloud of the cells with at least `seen` observations.

        `standing` may reject points: it maps points (N, 3) float32 to (N,) bool, True for points to keep."""
        sums, found = self._cells(seen), self.seen_points(seen)
        kept = np.ones(len(sums), bool) if standing is None else standing(found.points)
        sums, found = sums[kept], SeenPoints(found.points[kept], found.eyes[kept], found.say[kept])
        colors = np.clip(sums[:, 3:6] / sums[:, 9:10] + 0.5, 0, 255).astype(np.uint8)
        normals = normals_of(found.points, found.eyes - found.points)
        return FusedCloud(found.points, colors, normals, sums[:, 10].clip(0, 65535).astype(np.uint16))

    def _cells(self, seen: int) -> NDArray[np.float64]:
        """(N, 11) sums of each cell, sorted by cell: point, color, and camera position times weight; weight; count."""
        chosen = np.flatnonzero((self._sums[:, 10] >= max(seen, 1)) & (self._sums[:, 9] > 0))
        return np.asarray(self._sums[chosen[np.argsort(self._keys[chosen])]])


@njit(cache=True, nogil=True)
def _place(key: np.int64, table: NDArray[np.int64]) -> np.int64:
    """The row of `key` in `table` (M,), or an empty row for it. M is a power of two; more than half of the rows are
    empty."""
    mask = len(table) - 1
    mixed = np.uint64(key) * _GOLDEN
    at = np.int64((mixed ^ (mixed >> np.uint64(32))) & np.uint64(mask))
    while table[at] != key and table[at] != _EMPTY:
        at = np.int64((at + 1) & mask)
    return at


@njit(cache=True, nogil=True)
def _insert(
    keys: NDArray[np.int64], values: NDArray[np.float64], table: NDArray[np.int64], sums: NDArray[np.float64]
) -> None:
    """Insert distinct `keys` (N,) and their `values` (N, C) into an empty table."""
    for i in range(len(keys)):
        at = _place(keys[i], table)
        table[at] = keys[i]
        sums[at] = values[i]


@njit(cache=True, nogil=True, error_model="numpy")
def _add(
    lens: NDArray[np.float64],
    pose: NDArray[np.float64],
    inverse: NDArray[np.float32],
    weight: NDArray[np.float32],
    image: NDArray[np.uint8],
    voxel: float,
    table: NDArray[np.int64],
    sums: NDArray[np.float64],
) -> int:
    """Add the pixels of a map to the rows of `sums` (M, 11). Returns the number of new rows. `lens` is fx, fy, cx, cy;
    `pose` (3, 4) is camera to world."""
    fx, fy, cx, cy = lens
    far, point, new = 1 << 20, np.empty(3), 0
    for v in range(inverse.shape[0]):
        for u in range(inverse.shape[1]):
            w = inverse[v, u]
            if w <= 0:
                continue
            depth = 1.0 / w
            x, y = (u + 0.5 - cx) / fx * depth, (v + 0.5 - cy) / fy * depth
            key = np.int64(0)
            for c in range(3):
                point[c] = pose[c, 0] * x + pose[c, 1] * y + pose[c, 2] * depth + pose[c, 3]
                # Cells farther than a million cells from the origin are clamped to the outermost cell.
                cell = int(np.floor(min(max(point[c] / voxel, -far), far - 1.0)))
                key = np.int64(key << 21 | cell + far)
            at = _place(key, table)
            if table[at] == _EMPTY:
                table[at] = key
                new += 1
            # The standard deviation of a depth grows with its square, so its weight falls with the fourth power.
            near = min(w, 2.0)
            say = weight[v, u] * near * near * near * near
            row = sums[at]
            for c in range(3):
                row[c] += say * point[c]
                row[3 + c] += say * image[v, u, c]
                row[6 + c] += say * pose[c, 3]
            row[9] += say
            row[10] += 1
    return new


def normals_of(points: NDArray[np.float32], towards: NDArray[np.floating], neighbours: int = 24) -> NDArray[np.float32]:
    """(N, 3) float32 unit normals of `points` (N, 3): the direction in which their neighbors spread least.

    Each normal is oriented along `towards` (N, 3), the vectors from the points to the cameras."""
    from scipy.spatial import cKDTree

    if len(points) < 3:
        return np.asarray(towards / np.linalg.norm(towards, axis=1, keepdims=True), np.float32)
    _, index = cKDTree(points).query(points, k=min(neighbours, len(points)), workers=-1)
    out = np.empty((len(points), 3), np.float32)

    def fill(start: int) -> None:
        part = slice(start, start + 50_000)
        normal = axes_of(points[index[part]])[:, :, 0]
        normal *= np.where((normal * towards[part]).sum(axis=1) < 0, -1, 1)[:, None]
        out[part] = normal

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(fill, range(0, len(points), 50_000)))
    return out
