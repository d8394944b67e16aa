"""The rays of an image in the network's input: resized, stretched, or with a border."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, level_rays
from nvsim.networks.image_preparation import Placement


def placed_rays(camera: Camera, place: Placement) -> NDArray[np.float32]:
    """(1, 3, rows, columns) float32 unit vectors (right, down, forward) of the leveled `camera` for the pixels of the
    network's input. `place` is the position of the camera's image in it."""
    k = camera.intrinsics.scaled(place.wide, place.high)
    placed = Intrinsics(place.columns, place.rows, k.fx, k.fy, k.cx + place.left, k.cy + place.top)
    rays = level_rays(Camera(placed, camera.camera_to_world))
    return np.ascontiguousarray(rays.transpose(2, 0, 1)[None])
