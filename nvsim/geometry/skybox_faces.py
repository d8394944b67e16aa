"""The six faces of a skybox in the order of a Matterport3D strip, and the ray through each of their pixels.

Source: Matterport3DSimulator's skybox strips `<id>_skybox_small.jpg`: up, back, left, front, right, down, side by side;
front is the viewing direction of the pose. Camera axes are OpenCV's: x right, y down, z forward.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NAMES = ("up", "back", "left", "front", "right", "down")

# The axes of each face in the camera's frame: the directions of u (right in the face), of r (down in the face), and of
# the face itself.
_RIGHT = np.array([[-1, 0, 0], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]], float)
_DOWN = np.array([[0, 0, -1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1]], float)
_AHEAD = np.array([[0, -1, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0]], float)


def face_axes() -> NDArray[np.float64]:
    """(6, 3, 3) rotations from each face's own camera to the pose's camera: columns are right, down, and forward."""
    return np.stack([_RIGHT, _DOWN, _AHEAD], -1)


def face_rays(side: int) -> NDArray[np.float64]:
    """(6, side, side, 3) float64 directions through the pixel centers, in the camera's frame. Their length along the
    axis of their face is 1 (they are not unit vectors)."""
    along = (np.arange(side) + 0.5) / side * 2 - 1
    right, down = np.meshgrid(along, along)
    return np.stack([right, down, np.ones_like(right)], -1) @ np.swapaxes(face_axes(), -1, -2)[:, None]
