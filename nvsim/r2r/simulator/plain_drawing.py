"""Draws views from skybox strips with numpy and OpenCV, as `compiled_drawing` does.

OpenCV interpolates with weights in steps of 1/32 pixel, the compiled kernels with steps of 1/256.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray


def draw_colours(
    strip: NDArray[np.uint8],  # (side, 6 * side, 3)
    rays: NDArray[np.float32],  # (3, 3) from `rays_of`
    out: NDArray[np.uint8],  # (H, W, 3) output
) -> None:
    """Fills a view (H, W, 3) with colors from a strip."""
    side = strip.shape[0]
    face, u, v = _on_faces(rays.tobytes(), out.shape[0], out.shape[1], side)
    last = np.float32(side - 1)
    x, y = np.clip(u - np.float32(0.5), 0, last), np.clip(v - np.float32(0.5), 0, last)
    cv2.remap(strip, x + face * np.float32(side), y, cv2.INTER_LINEAR, dst=out)


def draw_depth(
    strip: NDArray[np.uint16],  # (side, 6 * side) distance from the camera, 0.25 mm
    rays: NDArray[np.float32],  # (3, 3) from `rays_of`
    plane: NDArray[np.float32],  # (4,) from `rays_of`
    out: NDArray[np.uint16],  # (H, W, 1) output: depth along the optical axis, 0.25 mm
) -> None:
    """Fills a view (H, W, 1) with depth from a strip."""
    side = strip.shape[0]
    height, width = out.shape[:2]
    face, u, v = _on_faces(rays.tobytes(), height, width, side)
    x, y = (np.minimum(a.astype(np.int64), side - 1) for a in (u, v))
    across = plane[0] + np.arange(width, dtype=np.float32) * plane[2]
    down = plane[1] + np.arange(height, dtype=np.float32)[:, None] * plane[3]
    away = strip[y, face.astype(np.int64) * side + x] / np.sqrt(1 + down * down + across * across)
    out[..., 0] = (away + 0.5).astype(np.uint16)


@lru_cache(maxsize=36)  # the discrete views of level poses
def _on_faces(
    rays: bytes, height: int, width: int, side: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Returns the face that the ray of each pixel meets, and the pixels right and down from its corner, each (H, W)."""
    first, right, down = np.frombuffer(rays, np.float32).reshape(3, 3)
    rows, columns = np.arange(height, dtype=np.float32)[:, None], np.arange(width, dtype=np.float32)
    x, y, z = (first[a] + rows * down[a] + columns * right[a] for a in range(3))
    ax, ay, az = np.abs(x), np.abs(y), np.abs(z)
    forward, sideways = (az >= ax) & (az >= ay), ax >= ay
    half = np.float32(side / 2)
    scale = half / np.where(forward, az, np.where(sideways, ax, ay))
    front, left, up = z > 0, x <= 0, y <= 0
    face = np.where(forward, np.where(front, 3, 1), np.where(sideways, np.where(left, 2, 4), np.where(up, 0, 5)))
    across = np.where(forward, np.where(front, x, -x), np.where(sideways, np.where(left, z, -z), -x))
    below = np.where(forward | sideways, y, np.where(up, -z, z))
    return face.astype(np.float32), half + across * scale, half + below * scale
