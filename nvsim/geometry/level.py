"""The level frame of a camera: it has the camera's heading, with axes right and forward along the ground, and straight
down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera

_LYING = 0.3  # horizontal length below which the right axis of a camera does not define its heading


def level_of(camera: Camera) -> NDArray[np.float64]:
    """(3, 3) float64; rows are right, down, and forward in the world. It maps world vectors to the level frame.

    The heading comes from the camera's right axis, so it is defined even if the camera looks straight down. If the
    image is rotated by a quarter turn, the heading comes from the optical axis.
    """
    right = np.array([camera.rotation[0, 0], camera.rotation[1, 0], 0.0])
    if np.linalg.norm(right) < _LYING:
        forward = camera.rotation[:, 2]
        right = np.array([forward[1], -forward[0], 0.0])
    length = float(np.linalg.norm(right))
    right = right / length if length > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.stack([right, (0.0, 0.0, -1.0), (-right[1], right[0], 0.0)])


def level_rays(camera: Camera) -> NDArray[np.float32]:
    """(H, W, 3) float32 unit directions through the pixel centers, in the level frame of the camera."""
    return np.asarray(camera.rays() @ level_of(camera).T, np.float32)
