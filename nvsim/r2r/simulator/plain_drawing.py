"""Draws views from skybox strips with numpy and OpenCV, as `compiled_drawing` does.

Each face that a view shows is drawn by a homography. OpenCV interpolates with weights in steps of 1/32 pixel, the
compiled kernels with steps of 1/256.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.directions import face_axes


def draw_colors(
    strip: NDArray[np.uint8],  # (side, 6 * side, 3)
    rays: NDArray[np.float32],  # (3, 3) from `rays_of`
    out: NDArray[np.uint8],  # (H, W, 3) output
) -> None:
    """Fills a view (H, W, 3) with colors from a strip."""
    _draw(strip, rays, out, cv2.INTER_LINEAR)


def draw_depth(
    strip: NDArray[np.uint16],  # (side, 6 * side) distance from the camera, 0.25 mm
    rays: NDArray[np.float32],  # (3, 3) from `rays_of`
    plane: NDArray[np.float32],  # (4,) from `rays_of`
    out: NDArray[np.uint16],  # (H, W, 1) output: depth along the optical axis, 0.25 mm
) -> None:
    """Fills a view (H, W, 1) with depth from a strip."""
    height, width = out.shape[:2]
    away = np.empty((height, width), np.uint16)
    _draw(strip, rays, away, cv2.INTER_NEAREST)
    cv2.multiply(away, _shares(plane.tobytes(), height, width), dst=out, dtype=cv2.CV_16U)


@lru_cache(maxsize=4)
def _shares(plane: bytes, height: int, width: int) -> NDArray[np.float32]:
    """Returns (H, W): depth along the optical axis divided by distance."""
    x, y, right, down = np.frombuffer(plane, np.float32)
    across = x + np.arange(width, dtype=np.float32) * right
    below = y + np.arange(height, dtype=np.float32)[:, None] * down
    return np.float32(1) / np.sqrt(1 + below * below + across * across)


def _draw(strip: NDArray[Any], rays: NDArray[np.float32], out: NDArray[Any], interpolation: int) -> None:
    """Fills a view (H, W) or (H, W, 3) with the faces that it shows."""
    side = strip.shape[0]
    flags = interpolation | cv2.WARP_INVERSE_MAP
    for face, homography, (left, top), mask in _visible_faces(rays.tobytes(), out.shape[0], out.shape[1], side):
        image = strip[:, face * side : (face + 1) * side]
        height, width = mask.shape
        # Beyond the centers of its border pixels, a face is constant.
        drawn = cv2.warpPerspective(image, homography, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        cv2.copyTo(drawn, mask, out[top : top + height, left : left + width])


@lru_cache(maxsize=128)
def _visible_faces(
    rays: bytes, height: int, width: int, side: int
) -> list[tuple[int, NDArray[Any], tuple[int, int], NDArray[np.uint8]]]:
    """Returns for each face that a view shows: its number, the homography from a rectangle of the view to the face, the
    first column and row of the rectangle, and (rows, columns) 255 for the pixels that show the face."""
    first, right, down = np.frombuffer(rays, np.float32).reshape(3, 3).astype(np.float64)
    pixels = np.stack([right, down, first], axis=1)
    to_face = np.array([[side / 2, 0, side / 2 - 0.5], [0, side / 2, side / 2 - 0.5], [0, 0, 1]])
    rows, found = np.arange(height), []
    for face, axes in enumerate(face_axes()):
        x, y, z = axes.T @ pixels  # the ray in the frame of the face, from a column, a row, and 1
        least, most = np.zeros(height), np.full(height, width - 1.0)
        for a, b, c in (z - x, z + x, z - y, z + y):  # not negative on the face
            if a == 0:
                most[b * rows + c < 0] = -1
            elif a > 0:
                least = np.maximum(least, -(b * rows + c) / a - _TIE)
            else:
                most = np.minimum(most, -(b * rows + c) / a + _TIE)
        used = np.flatnonzero(np.ceil(least) <= most)
        if len(used):
            top, end = int(used[0]), int(used[-1]) + 1
            left, beyond = int(np.ceil(least[used].min())), int(most[used].max()) + 1
            columns = np.arange(left, beyond, dtype=np.float32)
            ends = (v[top:end, None].astype(np.float32) for v in (least, most))
            mask = ((columns >= next(ends)) & (columns <= next(ends))).astype(np.uint8) * np.uint8(255)
            shift = np.array([[1, 0, left], [0, 1, top], [0, 0, 1]], np.float64)
            found.append((face, to_face @ np.stack([x, y, z]) @ shift, (left, top), mask))
    return found


_TIE = 1e-4  # pixels: a ray between two faces belongs to both, so that no pixel is without a face
