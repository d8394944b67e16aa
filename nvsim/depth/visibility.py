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
from nvsim.geometry.splatting import SplatCloud

Float32 = NDArray[np.float32]

_SAMPLES = 48  # points of a map of which it is asked which other images show them
_OVERLAP = 0.15  # share of these that another image shows, or it is no witness


class Rest:
    """The rest of a capture, asked about each of its depth maps: its `cameras`, their `maps` of inverse depth, (H, W)
    float32, 1 / metres, 0 where unknown, and the points (N, 3) of the cloud of all maps that are seen often enough."""

    def __init__(
        self, points: Float32, cameras: Sequence[Camera], maps: Callable[[int], Float32], config: DepthConfig
    ) -> None:
        self._cloud = SplatCloud.of(points, np.full(len(points), config.voxel / 2, np.float32))
        self._cameras, self._maps, self._config = cameras, maps, config
        self._positions = np.array([c.position for c in cameras]).reshape(-1, 3)

    def against(self, index: int) -> NDArray[np.bool_]:
        """(H, W): where it speaks against the map `index`."""
        inverse, camera, config = self._maps(index), self._cameras[index], self._config
        known = inverse > 0
        spoken = np.zeros(inverse.shape, bool)
        if not known.any():
            return spoken
        shown, _ = self._cloud.depth(camera, farthest=1.5 * config.farthest)
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
        some = points[:: max(len(points) // _SAMPLES, 1)]
        may = np.flatnonzero(
            np.linalg.norm(self._positions - self._positions[index], axis=1) < 2 * self._config.farthest
        )
        overlap = np.array([_seen(self._cameras[int(j)], some) if j != index else 0.0 for j in may])
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
