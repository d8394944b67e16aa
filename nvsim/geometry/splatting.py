"""Depth of the nearest point of a cloud at each pixel. Every point is drawn as a square of the size of its surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.kernels import njit

Float32 = NDArray[np.float32]

_BLOCK = 1.0  # meters: side of the cubes in which points are stored; a camera processes only cubes in its view
BLOCK_REACH = 0.87 * _BLOCK + 0.05
"""Meters from the middle of a block to its corners, and the rounding of large coordinates."""
_LARGEST = 24.0  # pixels
_PIXELS = 4  # pixels that are tested in the time in which a point is drawn
_ANY = 1e6  # meters


@njit(cache=True, nogil=True, fastmath=True)
def blocks_in_view(
    middles: NDArray[np.float32],  # (B, 3) meters, world, of `SplatCloud`
    reach: float | np.floating,  # meters from the middle of a block to its farthest content
    pose: NDArray[np.floating],  # (3, 4) rows of world-to-camera
    lens: NDArray[np.floating],  # (4,) fx, fy, cx, cy, pixels
    height: int,  # of the image, pixels, as `width`
    width: int,
    farthest: float | np.floating,  # meters from the camera beyond which blocks are skipped
) -> NDArray[np.int64]:
    """(K,) the blocks of which a camera may see a part, the nearest first."""
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    # The sides of the image, a pixel farther out, are planes through the camera: lens * offset + side * z >= 0 inside.
    left, right = cx + np.float32(1), width - cx + np.float32(1)
    upper, lower = cy + np.float32(1), height - cy + np.float32(1)
    by_left, by_right = reach * np.sqrt(fx * fx + left * left), reach * np.sqrt(fx * fx + right * right)
    by_upper, by_lower = reach * np.sqrt(fy * fy + upper * upper), reach * np.sqrt(fy * fy + lower * lower)
    blocks, away, count = np.empty(middles.shape[0], np.int64), np.empty(middles.shape[0], np.float32), 0
    for b in range(middles.shape[0]):
        x, y, z = middles[b, 0], middles[b, 1], middles[b, 2]
        zc = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        across = fx * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3])
        down = fy * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3])
        if zc < -reach or across + left * zc < -by_left or right * zc - across < -by_right:
            continue
        if down + upper * zc < -by_upper or lower * zc - down < -by_lower:
            continue
        aside, below = across / fx, down / fy
        if aside * aside + below * below + zc * zc > (farthest + reach) * (farthest + reach):
            continue
        blocks[count], away[count] = b, zc
        count += 1
    return blocks[np.argsort(away[:count])]


@njit(cache=True, nogil=True, fastmath=True)
def _splat(
    points: NDArray[np.float32],  # (N, 3) meters, world, block by block
    radii: NDArray[np.float32],  # (N,) meters
    order: NDArray[np.int32],  # (N,) at equal depth in a pixel, the point with the lowest value is drawn
    first: NDArray[np.int64],  # (B + 1,) index of the first point of each block
    middles: NDArray[np.float32],  # (B, 3) meters, world
    reach: np.float32,  # meters from the middle of a block to the farthest edge of a square in it
    pose: NDArray[np.float32],  # (3, 4) rows of world-to-camera
    lens: NDArray[np.float32],  # (4,) fx, fy, cx, cy, pixels
    largest: np.float32,  # half-width, pixels
    farthest: np.float32,  # meters from the camera beyond which blocks are skipped
    depth: NDArray[np.float32],  # (H, W) meters, updated
    extent: NDArray[np.float32],  # (H, W) meters, updated
    shown: NDArray[np.int32],  # (H, W) `order` of the drawn point, updated
) -> None:
    # Written without temporary arrays, because it processes half a million points for every frame.
    height, width = depth.shape
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    # In a building, most blocks are behind nearer ones, which are drawn first.
    for b in blocks_in_view(middles, reach, pose, lens, height, width, farthest):
        x, y, z = middles[b, 0], middles[b, 1], middles[b, 2]
        xc = pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]
        yc = pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]
        zc = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
        front, back = zc - reach, zc + reach
        if front > 0.05:
            c0 = max(int(np.floor(fx * min((xc - reach) / front, (xc - reach) / back) + cx)) - 1, 0)
            c1 = min(int(np.floor(fx * max((xc + reach) / front, (xc + reach) / back) + cx)) + 1, width - 1)
            r0 = max(int(np.floor(fy * min((yc - reach) / front, (yc - reach) / back) + cy)) - 1, 0)
            r1 = min(int(np.floor(fy * max((yc + reach) / front, (yc + reach) / back) + cy)) + 1, height - 1)
            covered = (r1 - r0) * (c1 - c0) < _PIXELS * (first[b + 1] - first[b])  # otherwise the test costs more
            for r in range(r0, r1 + 1):
                if not covered:
                    break
                for c in range(c0, c1 + 1):
                    if depth[r, c] >= front:
                        covered = False
                        break
            if covered:
                continue
        for i in range(first[b], first[b + 1]):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            zc = pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3]
            if zc < 0.05:
                continue
            u = fx * (pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3]) / zc + cx
            v = fy * (pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3]) / zc + cy
            half = min(radii[i] * fx / zc, largest)
            c0, c1 = int(np.ceil(u - half - 0.5)), int(np.floor(u + half - 0.5))
            r0, r1 = int(np.ceil(v - half - 0.5)), int(np.floor(v + half - 0.5))
            if c1 < c0:
                c0 = c1 = int(np.floor(u))
            if r1 < r0:
                r0 = r1 = int(np.floor(v))
            for r in range(max(r0, 0), min(r1, height - 1) + 1):
                for c in range(max(c0, 0), min(c1, width - 1) + 1):
                    if zc < depth[r, c] or (zc == depth[r, c] and order[i] < shown[r, c]):
                        depth[r, c] = zc
                        extent[r, c] = radii[i]
                        shown[r, c] = order[i]


def _cubes_of(coordinates: Float32) -> NDArray[np.int32]:
    return np.floor(coordinates / np.float32(_BLOCK)).astype(np.int32)


@dataclass(frozen=True, eq=False)
class SplatCloud:
    """Points sorted into cubes, so that a camera skips cubes outside its view.

    order    (N,) int32, index of each point in the caller's array
    points   (N, 3) float32 meters, world, in this order
    radii    (N,) float32 meters, half the width of the surface that a point represents, in this order
    first    (B + 1,) index of the first point of each block
    middles  (B, 3) float32 meters, world
    """

    order: NDArray[np.int32]
    points: Float32
    radii: Float32
    first: NDArray[np.int64]
    middles: Float32

    @staticmethod
    def of(points: Float32, radii: Float32) -> SplatCloud:
        """Sort `points` (N, 3), meters, world, and their `radii` (N,), meters, which may be in any order."""
        key = np.zeros(len(points), np.int64)
        for axis in (2, 1, 0):  # one after the other, because a large building has 20 million points
            cube = _cubes_of(points[:, axis])
            low = int(cube.min(initial=0))
            key *= int(cube.max(initial=0)) - low + 1
            key += cube - low
        del cube
        order = np.argsort(key, kind="stable").astype(np.int32)
        starts = np.flatnonzero(np.diff(key[order], prepend=-1))
        del key
        middles = ((_cubes_of(points[order[starts]]) + 0.5) * _BLOCK).astype(np.float32)
        return SplatCloud(order, points[order], radii[order], np.append(starts, len(points)), middles)

    def depth(self, camera: Camera, largest: float = _LARGEST, farthest: float = _ANY) -> tuple[Float32, Float32]:
        """Depth (H, W) float32 in meters along the optical axis of the nearest point, and radius (H, W) of that point.

        Depth is inf and radius 0 if there is no point. Each point is a square of at most `largest` pixels half-width.
        Points farther than `farthest` meters from the camera may be skipped, which saves time in a large building."""
        k = camera.intrinsics
        depth = np.full((k.height, k.width), np.inf, np.float32)
        extent = np.zeros((k.height, k.width), np.float32)
        pose = np.ascontiguousarray(camera.world_to_camera[:3], np.float32)
        lens = np.array([k.fx, k.fy, k.cx, k.cy], np.float32)
        reach = np.float32(BLOCK_REACH + 1.5 * self.radii.max(initial=0))  # half the diagonal of a square
        _splat(
            self.points, self.radii, self.order, self.first, self.middles, reach, pose, lens, np.float32(largest),
            np.float32(farthest), depth, extent, np.empty(depth.shape, np.int32),
        )  # fmt: skip
        return depth, extent
