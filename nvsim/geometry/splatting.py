"""Depth of the nearest cloud point per pixel: every point is a square as large as the surface it stands for."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera


@njit(cache=True, nogil=True, fastmath=True)
def _splat(
    points: NDArray[np.float32],  # (N, 3) metres, world
    radii: NDArray[np.float32],  # (N,) metres
    pose: NDArray[np.float32],  # (3, 4) rows of world-to-camera
    lens: NDArray[np.float32],  # (4,) fx, fy, cx, cy, pixels
    largest: np.float32,  # half-width, pixels
    depth: NDArray[np.float32],  # (H, W) metres, changed
    extent: NDArray[np.float32],  # (H, W) metres, changed
) -> None:
    # Written without temporaries: half a million points pass through here for every frame.
    height, width = depth.shape
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    for i in range(points.shape[0]):
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
                if zc < depth[r, c]:
                    depth[r, c] = zc
                    extent[r, c] = radii[i]


def splat_depth(
    points: NDArray[np.float32], radii: NDArray[np.float32], camera: Camera, largest: float = 24.0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Depth (H, W) float32 along the optical axis of the nearest of `points` (N, 3), each a square of half-width
    `radii` (N,) metres, at most `largest` pixels; inf where there is none. Beside it the radius (H, W) of that point,
    0 where there is none."""
    k = camera.intrinsics
    depth = np.full((k.height, k.width), np.inf, np.float32)
    extent = np.zeros((k.height, k.width), np.float32)
    pose = np.ascontiguousarray(camera.world_to_camera[:3], np.float32)
    lens = np.array([k.fx, k.fy, k.cx, k.cy], np.float32)
    _splat(points, radii, pose, lens, np.float32(largest), depth, extent)
    return depth, extent
