"""The cloud that depth maps make together: their points, averaged in cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.geometry.neighbourhood import axes_of

_EMPTY = -1


@dataclass(frozen=True, eq=False)
class FusedCloud:
    """points   (N, 3) float32, metres, world
    colors   (N, 3) uint8 RGB
    normals  (N, 3) float32, unit, towards the cameras
    views    (N,) uint16, how often the place was seen
    """

    points: NDArray[np.float32]
    colors: NDArray[np.uint8]
    normals: NDArray[np.float32]
    views: NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """points   (N, 3) float32, metres, world
    eyes     (N, 3) float32, the mean place of the cameras that saw them
    say      (N,) float32, what was seen adds up to this inverse variance, 1 / metres squared
    """

    points: NDArray[np.float32]
    eyes: NDArray[np.float32]
    say: NDArray[np.float32]


class Fusion:
    """Adds points up in cells of `voxel` metres: an open hash table, which grows."""

    def __init__(self, voxel: float) -> None:
        self.voxel = voxel
        self._keys = np.full(1 << 16, _EMPTY, np.int64)
        self._sums = np.zeros((1 << 16, 11), np.float64)
        self._filled = 0

    def add(
        self, camera: Camera, inverse: NDArray[np.float32], weight: NDArray[np.float32], image: NDArray[np.uint8]
    ) -> None:
        """The points of a map (H, W) of inverse depth, 0 where there is none, with its inverse variance (H, W) and
        their colours (H, W, 3) RGB."""
        v, u = np.nonzero(inverse > 0)
        if not len(v):
            return
        k = camera.intrinsics
        depth = 1.0 / inverse[v, u].astype(np.float64)
        local = np.stack([(u + 0.5 - k.cx) / k.fx * depth, (v + 0.5 - k.cy) / k.fy * depth, depth], 1)
        points = local @ camera.rotation.T + camera.position
        # The noise of a depth grows with its square, so its say falls with the fourth power.
        say = weight[v, u].astype(np.float64)[:, None] * np.minimum(1 / depth, 2.0)[:, None] ** 4
        values = np.concatenate(
            [say * points, say * image[v, u], say * camera.position, say, np.ones_like(say)], axis=1
        )
        while 2 * (self._filled + len(v)) > len(self._keys):
            keys, sums = self._keys, self._sums
            self._keys = np.full(2 * len(keys), _EMPTY, np.int64)
            self._sums = np.zeros((2 * len(keys), 11), np.float64)
            used = keys != _EMPTY
            _insert(keys[used], sums[used], self._keys, self._sums)
        self._filled += _insert(_keys(points, self.voxel), values, self._keys, self._sums)

    def seen_points(self, seen: int) -> SeenPoints:
        """The means of the cells that at least `seen` points fell into."""
        sums = self._cells(seen)
        say = sums[:, 9:10]
        points, eyes = (sums[:, :3] / say).astype(np.float32), (sums[:, 6:9] / say).astype(np.float32)
        return SeenPoints(points, eyes, say[:, 0].astype(np.float32))

    def cloud(self, seen: int) -> FusedCloud:
        """The cells that at least `seen` points fell into."""
        sums, found = self._cells(seen), self.seen_points(seen)
        colors = np.clip(sums[:, 3:6] / sums[:, 9:10] + 0.5, 0, 255).astype(np.uint8)
        normals = normals_of(found.points, found.eyes - found.points)
        return FusedCloud(found.points, colors, normals, sums[:, 10].clip(0, 65535).astype(np.uint16))

    def _cells(self, seen: int) -> NDArray[np.float64]:
        """(N, 11), in the order of their places: points, colours and cameras times their say, the say, how many."""
        chosen = np.flatnonzero(self._sums[:, 10] >= max(seen, 1))
        return np.asarray(self._sums[chosen[np.argsort(self._keys[chosen])]])


@njit(cache=True, nogil=True)
def _insert(
    keys: NDArray[np.int64], values: NDArray[np.float64], table: NDArray[np.int64], sums: NDArray[np.float64]
) -> int:
    """Adds `values` (N, C) to the rows of `sums` (M, C) that `table` (M,) gives to `keys` (N,); how many are new.
    M is a power of two, more than half empty."""
    mask = len(table) - 1
    new = 0
    for i in range(len(keys)):
        at = ((keys[i] * 0x9E3779B97F4A7C1) >> 20) & mask
        while table[at] != keys[i] and table[at] != _EMPTY:
            at = (at + 1) & mask
        if table[at] == _EMPTY:
            table[at] = keys[i]
            new += 1
        for c in range(values.shape[1]):
            sums[at, c] += values[i, c]
    return new


def normals_of(points: NDArray[np.float32], towards: NDArray[np.floating], neighbours: int = 24) -> NDArray[np.float32]:
    """(N, 3) float32 unit normals of points (N, 3): across which their neighbours spread least, turned `towards`
    (N, 3) the cameras."""
    from scipy.spatial import cKDTree

    if len(points) < 3:
        return np.asarray(towards / np.linalg.norm(towards, axis=1, keepdims=True), np.float32)
    _, index = cKDTree(points).query(points, k=min(neighbours, len(points)), workers=-1)
    out = np.empty((len(points), 3), np.float32)
    for start in range(0, len(points), 100_000):
        part = slice(start, start + 100_000)
        normal = axes_of(points[index[part]])[:, :, 0]
        normal *= np.where((normal * towards[part]).sum(axis=1) < 0, -1, 1)[:, None]
        out[part] = normal
    return out


def _keys(points: NDArray[np.float64], voxel: float) -> NDArray[np.int64]:
    """One number a cell; cells further than a million from the origin are taken for the outermost."""
    cell = np.floor(points / voxel).astype(np.int64).clip(-(1 << 20), (1 << 20) - 1) + (1 << 20)
    keys: NDArray[np.int64] = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
    return keys
