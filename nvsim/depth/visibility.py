"""Find depths that the rest of the capture contradicts (occlusions and free-space violations: Merrell et al., 2007).

A depth is contradicted if a surface is in front of it, no surface is at its end, or other cameras see through it.
Neighboring images make equal errors on bare surfaces and between bars, so depth that they confirm may still be wrong.
All maps together, and maps from the other side of a room, make different errors.
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

_SAMPLES = 48  # points of a map that are projected into the other images
_OVERLAP = 0.15  # least share of these points in the image of a witness


class Rest:
    """The rest of a capture, with which each of its depth maps is checked.

    points   (N, 3) float32, meters, world: the points of the fused cloud of all maps with enough observations
    cameras  the camera of each map
    maps     index -> inverse depth (H, W) float32, 1 / meters, 0 where unknown
    """

    def __init__(
        self, points: Float32, cameras: Sequence[Camera], maps: Callable[[int], Float32], config: DepthConfig
    ) -> None:
        self._cloud = SplatCloud.of(points, np.full(len(points), config.voxel / 2, np.float32))
        self._cameras, self._maps, self._config = cameras, maps, config
        self._positions = np.array([c.position for c in cameras]).reshape(-1, 3)

    def against(self, index: int) -> NDArray[np.bool_]:
        """(H, W) bool, True for pixels of the map `index` that the rest of the capture contradicts."""
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
        """Frames that show many of `points` (N, 3), each as far as possible from this frame and earlier choices."""
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
                break  # the remaining cameras are at positions of chosen cameras
            chosen.append(int(may[best]))
            far = np.minimum(far, np.linalg.norm(self._positions[may] - self._positions[may[best]], axis=1))
        return chosen


def _points(camera: Camera, inverse: Float32) -> Float32:
    """(N, 3) points of the known pixels of a map, in the order of the pixels."""
    known = inverse > 0
    rays = camera.rays()[known]
    depth = 1 / (inverse[known] * (rays @ camera.rotation[:, 2]))
    return np.asarray(camera.position + depth[:, None] * rays, np.float32)


def _seen(camera: Camera, points: Float32) -> float:
    """The share of points (N, 3) inside the camera's image, without regard to occlusion."""
    k = camera.intrinsics
    x, y, z = ((points - camera.position) @ camera.rotation).T
    inside = (z > 0) & (np.abs(k.fx * x + (k.cx - k.width / 2) * z) < k.width / 2 * z)
    return float((inside & (np.abs(k.fy * y + (k.cy - k.height / 2) * z) < k.height / 2 * z)).mean())
