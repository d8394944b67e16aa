"""The camera in the form for the kernels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera
from nvsim.render.kernel_types import TILE

EPS2D = 0.3
"""Variance of the pixel's low-pass filter, pixels squared."""
NEAR = 0.05
"""Distance along the optical axis below which Gaussians are not drawn, by their center; meters."""
_MARGIN = 0.15
# The affine approximation is computed at most this share of the image size outside the image, as is common: farther out
# it enlarges Gaussians without bound.


def pack(camera: Camera, antialiased: bool) -> NDArray[np.float32]:
    """The camera as the (33,) float32 row for the kernels: rotation and translation of world to camera, focal lengths,
    principal point, size, limits of x/z and y/z, camera position. Then filter variance, whether opacity is compensated,
    nearest depth, how much the slopes can enlarge a Gaussian, and the first and last requested pixel of a row and of a
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
    # Rows of the Jacobian are at most this long, times focal / z.
    view[28] = np.sqrt(1 + max(view[18] ** 2, view[19] ** 2, view[20] ** 2, view[21] ** 2))
    view[29:33] = 0, k.width - 1, 0, k.height - 1
    return view


def limit(view: NDArray[np.float32], tiles: NDArray[np.bool_]) -> None:
    """Limits a packed camera `view` (33,) to the bounding box of the requested `tiles` (lines, columns)."""
    lines, columns = np.flatnonzero(tiles.any(axis=1)), np.flatnonzero(tiles.any(axis=0))
    if len(lines) == 0:
        view[29:33] = 0, -1, 0, -1
        return
    view[29], view[30] = columns[0] * TILE, min(view[30], columns[-1] * TILE + TILE - 1)
    view[31], view[32] = lines[0] * TILE, min(view[32], lines[-1] * TILE + TILE - 1)
