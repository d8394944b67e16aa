"""The six faces of a skybox as Matterport3D lays them in a strip, and the ray through each of their pixels.

Source: Matterport3DSimulator's skybox strips `<id>_skybox_small.jpg`: up, back, left, front, right, down, side by side;
front is where the pose looks. Camera axes are OpenCV's: x right, y down, z ahead.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NAMES = ("up", "back", "left", "front", "right", "down")

# For each face its axes in the camera's frame: what u (right over the face), r (down over the face) and one unit
# ahead of it are worth.
_RIGHT = np.array([[-1, 0, 0], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]], float)
_DOWN = np.array([[0, 0, -1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1]], float)
_AHEAD = np.array([[0, -1, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]], float)


def face_axes() -> NDArray[np.float64]:
    """(6, 3, 3) rotations from each face's own camera to the pose's camera: columns are right, down and ahead."""
    return np.stack([_RIGHT, _DOWN, _AHEAD], -1)


def face_rays(side: int) -> NDArray[np.float64]:
    """(6, side, side, 3) directions through the centres of the pixels, in the camera's frame, of length 1 along the
    axis of their face (not unit)."""
    along = (np.arange(side) + 0.5) / side * 2 - 1
    right, down = np.meshgrid(along, along)
    return np.stack([right, down, np.ones_like(right)], -1) @ np.swapaxes(face_axes(), -1, -2)[:, None]
