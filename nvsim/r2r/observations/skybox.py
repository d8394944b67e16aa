"""The six faces of a viewpoint as one strip, and its depth strip, as Matterport3DSimulator reads them.

Format: `<id>_skybox_small.jpg` has six square faces side by side in the order of `nvsim.geometry.skybox_faces`. The
chroma is not subsampled, because it would bleed over the borders. `<id>_skybox_depth_small.png` has 16 bits, meters
along the ray times 4000.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look
from nvsim.geometry.floor_surface import FloorSurface
from nvsim.geometry.skybox_faces import face_axes
from nvsim.r2r.observations.floor_distance import distances
from nvsim.r2r.observations.surround import Surround

UNITS_A_METRE = 4000
"""A unit is 0.25 mm; 16 bits reach 16.38 m."""
FINER = 2
"""Samples per pixel of a face in each direction. The narrow views are drawn this much finer."""


@dataclass(frozen=True, eq=False)
class Skybox:
    """The strips of one viewpoint.

    colour  (S, 6 S, 3) uint8, RGB
    depth   (S, 6 S) uint16, units of 0.25 mm along the ray, 0 if there is no surface, 65535 from 16.38 m on
    """

    colour: NDArray[np.uint8]
    depth: NDArray[np.uint16]

    @property
    def faces(self) -> list[NDArray[np.uint8]]:
        """Six faces (S, S, 3) uint8, in the order of the strip."""
        return np.split(self.colour, 6, axis=1)


def face_cameras(position: NDArray[np.floating], side: int) -> list[Camera]:
    """Returns six cameras of 90 degrees and `side` x `side` pixels at `position` (3,), for a level pose facing +y."""
    intrinsics = Intrinsics(side, side, side / 2, side / 2, side / 2, side / 2)
    level = look(np.asarray(position, np.float64), 0.0)
    cameras = []
    for axes in face_axes():
        pose = level.copy()
        pose[:3, :3] = level[:3, :3] @ axes
        cameras.append(Camera(intrinsics, pose))
    return cameras


def focal_of(side: int) -> float:
    """Returns the focal length in pixels of the narrow views for faces of `side` pixels."""
    return FINER * side / 2


def skybox_of(surround: Surround, floor: FloorSurface, side: int) -> Skybox:
    """Returns the strips with faces of `side` pixels. The depth is that of `floor` where there are no Gaussians."""
    strip = Skybox(np.empty((side, 6 * side, 3), np.uint8), np.empty((side, 6 * side), np.uint16))
    for i, camera in enumerate(face_cameras(surround.position, side)):
        colour, solid = surround.colour_and_solid(camera, FINER)
        columns = slice(i * side, (i + 1) * side)
        strip.colour[:, columns] = as_bytes(colour)
        strip.depth[:, columns] = as_units(distances(solid, camera, floor))
    return strip


def as_bytes(colour: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Converts colors of any shape from 0 to 1 to uint8."""
    return np.asarray(np.clip(colour, 0, 1) * np.float32(255) + np.float32(0.5), np.uint8)


def as_units(metres: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Converts meters of any shape to uint16 in the unit of the depth files."""
    units = np.clip(metres.astype(np.float32) * np.float32(UNITS_A_METRE), 0, 65535)
    return np.asarray(np.rint(units), np.uint16)
