"""Records of a COLMAP model, for binary and text files alike: cameras, images, rigs, and frames of rigs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

MODEL_NAMES = (
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
    "SIMPLE_DIVISION",
    "DIVISION",
    "SIMPLE_FISHEYE",
    "FISHEYE",
    "EUCM",
    "EQUIRECTANGULAR",
)
"""Camera model names in the order of COLMAP's model ids (colmap/sensor/models.h)."""


@dataclass(frozen=True)
class CameraRow:
    """A camera as listed; `where` is the line or the record."""

    number: int
    model: str
    width: int
    height: int
    params: tuple[float, ...]
    where: str


@dataclass(frozen=True, eq=False)
class ImageRow:
    """An image as listed: world-to-camera quaternion (4,) w x y z and translation (3,)."""

    number: int
    quaternion: NDArray[np.float64]
    translation: NDArray[np.float64]
    camera: int
    name: str
    where: str


@dataclass(frozen=True, eq=False)
class RigRow:
    """A rig of COLMAP 3.12 and later.

    reference  camera id that defines the rig's axes, None if that sensor is not a camera
    mounts     camera id -> rig-to-camera quaternion (4,) w x y z and translation (3,); None if the pose is unknown
    """

    number: int
    reference: int | None
    mounts: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]] | None]
    where: str

    @property
    def cameras(self) -> frozenset[int]:
        return frozenset(self.mounts) | (frozenset() if self.reference is None else {self.reference})


@dataclass(frozen=True, eq=False)
class FrameRow:
    """One moment of a rig: world-to-rig quaternion (4,) w x y z, translation (3,), and the ids of its images."""

    number: int
    rig: int
    quaternion: NDArray[np.float64]
    translation: NDArray[np.float64]
    images: tuple[int, ...]
    where: str
