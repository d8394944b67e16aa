"""What the lists of a COLMAP model hold, binary or text alike: cameras and images."""

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
)


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
