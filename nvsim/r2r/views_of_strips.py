"""Perspective views sampled from the strip of a skybox: what Matterport3DSimulator shows of it.

As in the simulator: linear between the pixels of a face, and not over its borders (OpenGL's clamp to edge).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.geometry.camera import Camera
from nvsim.r2r.faces import face_axes

Uint8 = NDArray[np.uint8]


class StripViews:
    """Views from the strips of viewpoints whose pose has the same rotation: where each pixel lies in a strip is
    computed once.

    cameras   whose rotations and intrinsics the views have; their positions do not matter
    rotation  (3, 3) camera-to-world of the pose, to which the faces are laid
    side      pixels of a face
    """

    def __init__(self, cameras: list[Camera], rotation: NDArray[np.floating], side: int) -> None:
        import cv2

        self.side = side
        self._maps = [cv2.convertMaps(*_places(camera, rotation, side), cv2.CV_16SC2) for camera in cameras]

    def view(self, strip: Uint8, index: int) -> Uint8:
        """(H, W, C) of the camera `index`, of a `strip` (side, 6 side, C)."""
        import cv2

        return np.asarray(cv2.remap(strip, *self._maps[index], cv2.INTER_LINEAR))


def side_of(strip: Uint8, where: str) -> int:
    """Pixels of a face. Raises InputError unless the strip is six squares side by side."""
    height, width = strip.shape[:2]
    if width != 6 * height:
        raise InputError(f"{where} is {width}x{height} pixels; a strip is six square faces side by side.")
    return int(height)


def _places(
    camera: Camera, rotation: NDArray[np.floating], side: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Column and line in the strip of each pixel, (H, W) each, counted from the centre of the first pixel."""
    rays = camera.rays() @ np.asarray(rotation, np.float32)  # in the pose's camera
    onto = _across_faces()
    ahead = rays @ onto[2]  # (H, W, 6), how far ahead of each face the ray leads
    face = np.argmax(ahead, axis=-1)
    ahead = np.take_along_axis(ahead, face[..., None], -1)[..., 0]
    places = []
    for axis in onto[:2]:
        along = np.take_along_axis(rays @ axis, face[..., None], -1)[..., 0] / ahead
        places.append(np.clip((along + 1) / 2 * side - 0.5, 0, side - 1))
    column, line = places
    return np.asarray(column + face * side, np.float32), np.asarray(line, np.float32)


@lru_cache(maxsize=1)
def _across_faces() -> NDArray[np.float32]:
    """(3, 3, 6): for right, down and ahead the axes of the six faces as columns, in the pose's camera."""
    return np.ascontiguousarray(face_axes().transpose(2, 1, 0), np.float32)
