"""Find depths that the rest of the capture contradicts (occlusions and free-space violations: Merrell et al., 2007).

A depth is contradicted if a surface is in front of it, no surface is at its end, or other cameras see through it.
Neighboring images make equal errors on bare surfaces and between bars, so depth that they confirm may still be wrong.
All maps together, and maps from the other side of a room, make different errors.

Depth maps see through points that do not exist. The vote of a map is the number of its pixels that cover a patch of the
point's cell size, so it falls with the squared distance. The thin top of a table is a line of pixels for many cameras
across the room, which see the wall behind it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from nvsim.depth.config import DepthConfig
from nvsim.geometry.camera import Camera
from nvsim.geometry.splatting import BLOCK_REACH, SplatCloud, blocks_in_view
from nvsim.kernels import njit

Float32 = NDArray[np.float32]

_TIMES = 2  # a point is kept if the pixels that show it are at least this many times the pixels that see through it
_PIXELS = 4096.0  # vote of a map one meter from its camera; votes are integers, so their sums are exact
_NEAREST = 2.5  # meters: nearer cameras vote like this distance, so a single camera beside a wall cannot remove it
_SHOWN = 0.05  # share of its inverse depth within which a map shows a point
_THROUGH = 0.1  # share of its inverse depth by which a map must be farther to see through a point


@njit(cache=True, nogil=True, error_model="numpy")
def _judge(
    points: Float32,
    lens: NDArray[np.float64],
    pose: NDArray[np.float64],
    inverse: Float32,
    shown: NDArray[np.int64],
    through: NDArray[np.int64],
) -> None:
    """Count for `points` (N, 3) the pixels of the map `inverse` (H, W), 0 where unknown, that show or see through them.
    `lens` is fx, fy, cx, cy; `pose` (3, 4) is world to camera."""
    height, width = inverse.shape
    fx, fy, cx, cy = lens
    for i in range(len(points)):
        x, y, z = points[i]
        depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        if depth <= 0.05:
            continue
        u = fx * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / depth + cx
        v = fy * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / depth + cy
        if not (u >= 0 and v >= 0 and u < width and v < height):
            continue
        there = inverse[int(v), int(u)]
        if there <= 0:
            continue
        pixels = int(_PIXELS / max(depth, _NEAREST) ** 2)
        if there * depth < 1 - _THROUGH:
            through[i] += pixels
        elif abs(there * depth - 1) < _SHOWN:
            shown[i] += pixels


@njit(cache=True, nogil=True, error_model="numpy")
def _judge_blocks(
    points: Float32,  # (N, 3) meters, world, block by block, as in `SplatCloud`
    first: NDArray[np.int64],  # (B + 1,)
    blocks: NDArray[np.int64],  # (K,) blocks whose points are judged
    lens: NDArray[np.float64],  # as in `_judge`, like all following
    pose: NDArray[np.float64],
    inverse: Float32,
    shown: NDArray[np.int64],
    through: NDArray[np.int64],
) -> None:
    """`_judge` for some blocks."""
    for b in blocks:
        here = slice(first[b], first[b + 1])
        _judge(points[here], lens, pose, inverse, shown[here], through[here])


def add_depth_votes(
    points: Float32, camera: Camera, inverse: Float32, shown: NDArray[np.int64], through: NDArray[np.int64]
) -> None:
    """Add the votes of one depth map about the points (N, 3) float32, meters, world.

    `inverse` (H, W) float32 is the inverse depth seen by `camera`, 1 / meters, 0 where unknown. Votes of pixels that
    show a point are added to `shown` (N,); votes of pixels that see through it to `through` (N,)."""
    _judge(points, *_lens_and_pose(camera), inverse, shown, through)


def _lens_and_pose(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    k = camera.intrinsics
    return np.array([k.fx, k.fy, k.cx, k.cy]), np.ascontiguousarray(camera.world_to_camera[:3], np.float64)


class Carver:
    """Finds the points that depth maps show rather than see through. Points may come in parts.

    `maps` gives the inverse depth map of a camera by its index: (H, W) float32 of the size of the camera, 1 / meters, 0
    where unknown."""

    def __init__(self, cameras: Sequence[Camera], maps: Callable[[int], Float32], threads: int) -> None:
        self._cameras, self._maps, self._threads = cameras, maps, threads
        self._positions = np.array([c.position for c in cameras]).reshape(-1, 3)
        self._reach = np.full(len(cameras), np.inf)  # meters from a camera beyond which its map has no votes

    def exists(self, points: Float32) -> NDArray[np.bool_]:
        """(N,) bool, True for `points` (N, 3) float32, meters, world, that exist."""
        if not len(points):
            return np.zeros(0, bool)
        away = np.maximum(np.maximum(points.min(axis=0) - self._positions, self._positions - points.max(axis=0)), 0)
        near = np.flatnonzero(np.linalg.norm(away, axis=1) <= self._reach)
        cloud = SplatCloud.of(points, np.zeros(len(points), np.float32))

        def count(first: int) -> NDArray[np.int64]:
            counts = np.zeros((2, len(points)), np.int64)
            for i in map(int, near[first :: self._threads]):
                if len(self._blocks_in_reach(cloud, i)):
                    inverse = self._maps(i)
                    self._reach[i] = _farthest_vote(self._cameras[i], inverse)
                    lens_and_pose, blocks = _lens_and_pose(self._cameras[i]), self._blocks_in_reach(cloud, i)
                    _judge_blocks(cloud.points, cloud.first, blocks, *lens_and_pose, inverse, *counts)
            return counts

        with ThreadPoolExecutor(self._threads) as pool:
            shown, through = sum(pool.map(count, range(self._threads)), np.zeros((2, len(points)), np.int64))
        found = np.empty(len(points), bool)
        found[cloud.order] = shown >= _TIMES * through
        return found

    def _blocks_in_reach(self, cloud: SplatCloud, index: int) -> NDArray[np.int64]:
        """(K,) the blocks of `cloud` about which the map `index` may vote, as far as is known."""
        lens, pose = _lens_and_pose(self._cameras[index])
        k = self._cameras[index].intrinsics
        return blocks_in_view(cloud.middles, BLOCK_REACH, pose, lens, k.height, k.width, self._reach[index])


def _farthest_vote(camera: Camera, inverse: Float32) -> float:
    """Meters from the camera to the farthest point for which the map `inverse` (H, W) has a vote; 0 if it has none."""
    known = inverse[inverse > 0]
    k = camera.intrinsics
    corner = np.linalg.norm([max(k.cx, k.width - k.cx) / k.fx, max(k.cy, k.height - k.cy) / k.fy, 1])
    return float(1.01 * (1 + _SHOWN) * corner / known.min()) if len(known) else 0.0


_SAMPLES = 48  # points of a map that are projected into the other images
_OVERLAP = 0.15  # least share of these points in the image of a checking map


class DepthCheck:
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
        seen = [(*_lens_and_pose(c), (c.intrinsics.width, c.intrinsics.height)) for c in cameras]
        self._lenses, self._poses, self._sizes = (np.array(column) for column in zip(*seen, strict=True))

    def contradicted_pixels(self, index: int) -> NDArray[np.bool_]:
        """(H, W) bool, True for pixels of the map `index` that the rest of the capture contradicts."""
        inverse, camera, config = self._maps(index), self._cameras[index], self._config
        known = inverse > 0
        spoken = np.zeros(inverse.shape, bool)
        if not known.any():
            return spoken
        shown, _ = self._cloud.depth(camera, farthest=1.5 * config.farthest)
        known_here = known & np.isfinite(shown)
        spoken[known_here] = np.abs(shown[known_here] * inverse[known_here] - 1) > config.max_difference
        points = _points(camera, inverse)
        votes = np.zeros((2, len(points)), np.int64)
        for other in self._choose_check_frames(index, points):
            add_depth_votes(points, self._cameras[other], self._maps(other), votes[0], votes[1])
        spoken[known] |= votes[1] > config.seen_through * votes.sum(axis=0)
        return spoken

    def _choose_check_frames(self, index: int, points: Float32) -> list[int]:
        """Frames that show many of `points` (N, 3), each as far as possible from this frame and earlier choices."""
        some = points[:: max(len(points) // _SAMPLES, 1)]
        may = np.flatnonzero(
            np.linalg.norm(self._positions - self._positions[index], axis=1) < 2 * self._config.farthest
        )
        overlap = _shares_in_view(some, self._lenses[may], self._poses[may], self._sizes[may])
        overlap[may == index] = 0
        may, overlap = may[overlap >= _OVERLAP], overlap[overlap >= _OVERLAP]
        far = np.linalg.norm(self._positions[may] - self._positions[index], axis=1)
        chosen: list[int] = []
        while len(chosen) < min(self._config.checking_maps, len(may)):
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


@njit(cache=True, nogil=True, error_model="numpy")
def _shares_in_view(
    points: Float32, lenses: NDArray[np.float64], poses: NDArray[np.float64], sizes: NDArray[np.int64]
) -> NDArray[np.float64]:
    """(M,) the share of `points` (N, 3) inside the image of each of M cameras, without regard to occlusion.

    `lenses` (M, 4) and `poses` (M, 3, 4) are as in `_judge`; `sizes` (M, 2) are the width and height of the images."""
    shares = np.zeros(len(lenses))
    for m in range(len(lenses)):
        (fx, fy, cx, cy), pose, (width, height) = lenses[m], poses[m], sizes[m]
        for i in range(len(points)):
            x, y, z = points[i]
            depth = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
            if depth <= 0:
                continue
            across = fx * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) + cx * depth
            down = fy * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) + cy * depth
            if 0 < across < width * depth and 0 < down < height * depth:
                shares[m] += 1
    return shares / len(points)
