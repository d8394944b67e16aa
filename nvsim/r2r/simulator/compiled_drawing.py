"""Draws views from skybox strips with compiled kernels. `plain_drawing` does the same without numba.

Each pixel's ray is looked up on one of the six faces. Colors are interpolated bilinearly within a face; beyond the
centers of its border pixels they are constant. Depth is that of the nearest pixel. This is how OpenGL draws them for
Matterport3DSimulator: linear and nearest filter, clamped to the edge, not seamless.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.kernels import njit


@njit(cache=True, nogil=True, inline="always")
def _on_face(x: np.float32, y: np.float32, z: np.float32, half: np.float32) -> tuple[int, np.float32, np.float32]:
    """Returns the face that a ray meets, and the pixels right and down from its corner; its center is `half` of both.

    This is the table of `nvsim.geometry.directions`, written out. A lookup for each pixel would double the time.
    """
    ax, ay, az = abs(x), abs(y), abs(z)
    if az >= ax and az >= ay:
        scale = half / az
        return (3, half + x * scale, half + y * scale) if z > 0 else (1, half - x * scale, half + y * scale)
    if ax >= ay:
        scale = half / ax
        return (4, half - z * scale, half + y * scale) if x > 0 else (2, half + z * scale, half + y * scale)
    scale = half / ay
    return (5, half - x * scale, half + z * scale) if y > 0 else (0, half - x * scale, half - z * scale)


@njit(cache=True, nogil=True, fastmath={"contract", "arcp", "nsz"})
def draw_colors(
    strip: NDArray[np.uint8],  # (side, 6 * side, 3)
    rays: NDArray[np.float32],  # (3, 3) from `rays_of`
    out: NDArray[np.uint8],  # (H, W, 3) output
) -> None:
    """Fills a view (H, W, 3) with colors from a strip."""
    side = strip.shape[0]
    stride = 18 * side
    half, last, center = np.float32(side / 2), np.float32(side - 1), np.float32(0.5)
    full, half_step, sixteen = np.uint32(256), np.uint32(32768), np.uint32(16)
    pixels = strip.reshape(-1)
    for row in range(out.shape[0]):
        x0 = rays[0, 0] + np.float32(row) * rays[2, 0]
        y0 = rays[0, 1] + np.float32(row) * rays[2, 1]
        z0 = rays[0, 2] + np.float32(row) * rays[2, 2]
        for column in range(out.shape[1]):
            c = np.float32(column)
            x, y, z = x0 + c * rays[1, 0], y0 + c * rays[1, 1], z0 + c * rays[1, 2]
            face, u, v = _on_face(x, y, z, half)
            u = min(max(u - center, np.float32(0)), last)
            v = min(max(v - center, np.float32(0)), last)
            left, top = np.int64(u), np.int64(v)
            # Weights in steps of 1/256, as in the texture units of graphics cards.
            fu = np.uint32((u - np.float32(left)) * np.float32(256))
            fv = np.uint32((v - np.float32(top)) * np.float32(256))
            # Unsigned, because a signed index is checked for negative values each time.
            at = np.uintp(top * stride + (face * side + left) * 3)
            right = at + np.uintp(3 if left < side - 1 else 0)
            down = np.uintp(stride if top < side - 1 else 0)
            for channel in range(3):
                k = np.uintp(channel)
                upper = np.uint32(pixels[at + k]) * (full - fu) + np.uint32(pixels[right + k]) * fu
                lower = np.uint32(pixels[at + down + k]) * (full - fu) + np.uint32(pixels[right + down + k]) * fu
                out[row, column, channel] = np.uint8((upper * (full - fv) + lower * fv + half_step) >> sixteen)


@njit(cache=True, nogil=True, fastmath={"contract", "arcp", "nsz"})
def draw_depth(
    strip: NDArray[np.uint16],  # (side, 6 * side) distance from the camera, 0.25 mm
    rays: NDArray[np.float32],  # (3, 3) from `rays_of`
    plane: NDArray[np.float32],  # (4,) from `rays_of`
    out: NDArray[np.uint16],  # (H, W, 1) output: depth along the optical axis, 0.25 mm
) -> None:
    """Fills a view (H, W, 1) with depth from a strip."""
    side = strip.shape[0]
    half = np.float32(side / 2)
    one = np.float32(1)
    for row in range(out.shape[0]):
        r = np.float32(row)
        py = plane[1] + r * plane[3]
        across = one + py * py
        x0, y0, z0 = rays[0, 0] + r * rays[2, 0], rays[0, 1] + r * rays[2, 1], rays[0, 2] + r * rays[2, 2]
        for column in range(out.shape[1]):
            c = np.float32(column)
            x, y, z = x0 + c * rays[1, 0], y0 + c * rays[1, 1], z0 + c * rays[1, 2]
            face, u, v = _on_face(x, y, z, half)
            px = plane[0] + c * plane[2]
            distance = strip[min(np.int64(v), side - 1), face * side + min(np.int64(u), side - 1)]
            away = np.float32(distance) / math.sqrt(across + px * px)
            out[row, column, 0] = np.uint16(away + np.float32(0.5))
