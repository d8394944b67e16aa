"""The cloud that depth maps make together: their points, averaged in cells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera


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


class Fusion:
    """Adds points up in cells of `voxel` metres; the order in which maps come does not change the cells."""

    def __init__(self, voxel: float) -> None:
        self.voxel = voxel
        self._keys = np.empty(0, np.int64)
        self._sums = np.empty((0, 10))

    def add(self, camera: Camera, inverse: NDArray[np.float32], image: NDArray[np.uint8]) -> None:
        """The points of a map (H, W) of inverse depth, 0 where there is none, with their colours (H, W, 3) RGB."""
        v, u = np.nonzero(inverse > 0)
        if not len(v):
            return
        k = camera.intrinsics
        depth = 1.0 / inverse[v, u].astype(np.float64)
        local = np.stack([(u + 0.5 - k.cx) / k.fx * depth, (v + 0.5 - k.cy) / k.fy * depth, depth], 1)
        points = local @ camera.rotation.T + camera.position
        towards = camera.position - points
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        values = np.concatenate([points, image[v, u].astype(np.float64), towards, np.ones((len(v), 1))], axis=1)
        self._merge(_keys(points, self.voxel), values)

    def _merge(self, keys: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        everything = np.concatenate([self._keys, keys])
        unique, index = np.unique(everything, return_inverse=True)
        both = np.concatenate([self._sums, values])
        self._sums = np.stack(
            [np.bincount(index.reshape(-1), both[:, c], minlength=len(unique)) for c in range(both.shape[1])], axis=1
        )
        self._keys = unique

    def cloud(self, seen: int) -> FusedCloud:
        """The cells that at least `seen` points fell into."""
        sums = self._sums[self._sums[:, 9] >= seen]
        count = sums[:, 9:]
        points = (sums[:, :3] / count).astype(np.float32)
        colors = np.clip(sums[:, 3:6] / count + 0.5, 0, 255).astype(np.uint8)
        return FusedCloud(
            points, colors, normals_of(points, sums[:, 6:9] / count), count[:, 0].clip(0, 65535).astype(np.uint16)
        )


def normals_of(points: NDArray[np.float32], towards: NDArray[np.float64], neighbours: int = 12) -> NDArray[np.float32]:
    """(N, 3) float32 unit normals of points (N, 3): across which their neighbours spread least, turned `towards`
    (N, 3) the cameras."""
    from scipy.spatial import cKDTree

    if len(points) < 3:
        return np.asarray(towards / np.linalg.norm(towards, axis=1, keepdims=True), np.float32)
    _, index = cKDTree(points).query(points, k=min(neighbours, len(points)), workers=-1)
    out = np.empty((len(points), 3), np.float32)
    for start in range(0, len(points), 100_000):
        part = slice(start, start + 100_000)
        around = points[index[part]].astype(np.float64)
        around -= around.mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
        normal = vectors[:, :, 0]
        normal *= np.where((normal * towards[part]).sum(axis=1) < 0, -1, 1)[:, None]
        out[part] = normal
    return out


def _keys(points: NDArray[np.float64], voxel: float) -> NDArray[np.int64]:
    """One number a cell; cells further than a million from the origin are taken for the outermost."""
    cell = np.floor(points / voxel).astype(np.int64).clip(-(1 << 20), (1 << 20) - 1) + (1 << 20)
    keys: NDArray[np.int64] = (cell[:, 0] << 42) | (cell[:, 1] << 21) | cell[:, 2]
    return keys
