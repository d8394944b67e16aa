"""The camera as the kernels read it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.layout import TILE

EPS2D = 0.3
"""Variance of the pixel's low-pass filter, pixels squared."""
NEAR = 0.05
"""Gaussians whose centre is nearer than this along the optical axis are not drawn, metres."""
_MARGIN = 0.15
# The affine approximation is taken at most this share of the image size outside it, as is the custom: farther out it
# stretches Gaussians without bound.


def pack(camera: Camera, antialiased: bool) -> NDArray[np.float32]:
    """The camera as the (33,) float32 row that the kernels read: rotation and translation of world to camera, focal
    lengths, principal point, size, limits of x/z and y/z, eye, filter variance, whether opacity is compensated, nearest
    depth, how far the slopes can stretch a Gaussian, and the first and last pixel that is wanted, of a row and of a
    column (see `limit`)."""
    k = camera.intrinsics
    view = np.empty(33, np.float32)
    view[0:9] = camera.world_to_camera[:3, :3].reshape(-1)
    view[9:12] = camera.world_to_camera[:3, 3]
    view[12:18] = k.fx, k.fy, k.cx, k.cy, k.width, k.height
    view[18:20] = -(k.cx + _MARGIN * k.width) / k.fx, (k.width - k.cx + _MARGIN * k.width) / k.fx
    view[20:22] = -(k.cy + _MARGIN * k.height) / k.fy, (k.height - k.cy + _MARGIN * k.height) / k.fy
    view[22:25] = camera.position
    view[25:28] = EPS2D, antialiased, NEAR
    # Rows of the Jacobian are at most focal / z times this long.
    view[28] = np.sqrt(1 + max(view[18] ** 2, view[19] ** 2, view[20] ** 2, view[21] ** 2))
    view[29:33] = 0, k.width - 1, 0, k.height - 1
    return view


def limit(view: NDArray[np.float32], tiles: NDArray[np.bool_]) -> None:
    """Narrows a packed camera to the bounding box of the `tiles` (lines, columns) that are wanted."""
    lines, columns = np.flatnonzero(tiles.any(axis=1)), np.flatnonzero(tiles.any(axis=0))
    if len(lines) == 0:
        view[29:33] = 0, -1, 0, -1
        return
    view[29], view[30] = columns[0] * TILE, min(view[30], columns[-1] * TILE + TILE - 1)
    view[31], view[32] = lines[0] * TILE, min(view[32], lines[-1] * TILE + TILE - 1)
