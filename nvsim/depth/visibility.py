"""Depths that the rest of the capture speaks against: something stands before them, nothing stands where they end, or
cameras elsewhere see through them (occlusions and violations of free space: Merrell et al., 2007).

Neighbouring images err alike on bare surfaces and between bars, so that what a map's neighbours confirm may still be
wrong. All maps together, and those from the other side of a room, err elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from nvsim.depth.carving import judge
from nvsim.depth.config import DepthConfig
from nvsim.geometry.camera import Camera
from nvsim.geometry.splatting import splat_depth

Float32 = NDArray[np.float32]

_BLOCK = 4.0  # metres: points are looked up in cubes of this edge
_SAMPLES = (6, 8)  # rows and columns of an image at which it is asked which other images show the same
_OVERLAP = 0.15  # share of these that another image shows, or it is no witness


class Rest:
    """What a capture says about each of its depth maps: its `cameras`, their `maps` of inverse depth, (H, W) float32,
    1 / metres, 0 where unknown, and the points (N, 3) of the cloud of all maps that are seen often enough."""

    def __init__(
        self, points: Float32, cameras: Sequence[Camera], maps: Callable[[int], Float32], config: DepthConfig
    ) -> None:
        self._blocks = _Blocks(points)
        self._cameras, self._maps, self._config = cameras, maps, config
        self._positions = np.array([c.position for c in cameras]).reshape(-1, 3)

    def against(self, index: int) -> NDArray[np.bool_]:
        """(H, W): where it speaks against the map `index`."""
        inverse, camera, config = self._maps(index), self._cameras[index], self._config
        known = inverse > 0
        spoken = np.zeros(inverse.shape, bool)
        if not known.any():
            return spoken
        near = self._blocks.before(camera, config.farthest)
        shown, _ = splat_depth(near, np.full(len(near), config.voxel / 2, np.float32), camera)
        known_here = known & np.isfinite(shown)
        spoken[known_here] = np.abs(shown[known_here] * inverse[known_here] - 1) > config.apart
        points = _points(camera, inverse)
        votes = np.zeros((2, len(points)), np.int64)
        for other in self._witnesses(index, points):
            judge(points, self._cameras[other], self._maps(other), votes[0], votes[1])
        spoken[known] |= votes[1] > config.seen_through * votes.sum(axis=0)
        return spoken

    def _witnesses(self, index: int, points: Float32) -> list[int]:
        """The frames that show much of `points` (N, 3), each as far as can be from this one and from those before."""
        some = points[:: max(len(points) // (_SAMPLES[0] * _SAMPLES[1]), 1)]
        may = np.flatnonzero(
            np.linalg.norm(self._positions - self._positions[index], axis=1) < 2 * self._config.farthest
        )
        overlap = np.array([_seen(self._cameras[j], some) if j != index else 0.0 for j in may])
        may, overlap = may[overlap >= _OVERLAP], overlap[overlap >= _OVERLAP]
        far = np.linalg.norm(self._positions[may] - self._positions[index], axis=1)
        chosen: list[int] = []
        while len(chosen) < min(self._config.witnesses, len(may)):
            best = int((overlap * far).argmax())
            if far[best] <= 0:
                break  # they stand where another stands
            chosen.append(int(may[best]))
            far = np.minimum(far, np.linalg.norm(self._positions[may] - self._positions[may[best]], axis=1))
        return chosen


class _Blocks:
    """Points (N, 3), sorted by cubes, so that those before a camera are found without looking at all."""

    def __init__(self, points: Float32) -> None:
        cubes = np.floor(points / _BLOCK).astype(np.int64)
        order = np.lexsort(cubes.T)
        self._points, cubes = points[order], cubes[order]
        new = np.any(np.diff(cubes, axis=0) != 0, axis=1) if len(points) else np.zeros(0, bool)
        self._starts = np.concatenate([[0], np.flatnonzero(new) + 1, [len(points)]]).astype(np.int64)
        self._middles = (cubes[self._starts[:-1]] + 0.5) * _BLOCK if len(points) else np.empty((0, 3))

    def before(self, camera: Camera, farthest: float) -> Float32:
        """(M, 3) those that the camera may see within `farthest` metres, and some more."""
        if not len(self._middles):
            return self._points
        k, radius = camera.intrinsics, _BLOCK * 3**0.5 / 2
        local = (self._middles - camera.position) @ camera.rotation
        sides = np.array(
            [[k.fx, 0, k.cx], [-k.fx, 0, k.width - k.cx], [0, k.fy, k.cy], [0, -k.fy, k.height - k.cy], [0, 0, 1]]
        )
        sides /= np.linalg.norm(sides, axis=1, keepdims=True)
        inside = (local @ sides.T > -radius).all(axis=1) & (local[:, 2] < farthest + radius)
        rows = [np.arange(self._starts[i], self._starts[i + 1]) for i in np.flatnonzero(inside)]
        return self._points[np.concatenate(rows)] if rows else self._points[:0]


def _points(camera: Camera, inverse: Float32) -> Float32:
    """(N, 3) the points of a map where it is known, in the order of its pixels."""
    known = inverse > 0
    rays = camera.rays()[known]
    depth = 1 / (inverse[known] * (rays @ camera.rotation[:, 2]))
    return np.asarray(camera.position + depth[:, None] * rays, np.float32)


def _seen(camera: Camera, points: Float32) -> float:
    """The share of points (N, 3) that lie in the camera's image, whatever stands before them."""
    k = camera.intrinsics
    x, y, z = ((points - camera.position) @ camera.rotation).T
    inside = (z > 0) & (np.abs(k.fx * x + (k.cx - k.width / 2) * z) < k.width / 2 * z)
    return float((inside & (np.abs(k.fy * y + (k.cy - k.height / 2) * z) < k.height / 2 * z)).mean())
