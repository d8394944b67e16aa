"""The 36 discretized views of a viewpoint: twelve headings, each looking down, level, and up.

Source: Matterport3DSimulator with `setDiscretizedViewingAngles(True)`; the order is that of its viewIndex.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nvsim.geometry.camera import Camera, Intrinsics, look

VIEWS = 36  # three elevations of twelve headings
WIDTH, HEIGHT = 640, 480
VFOV = math.radians(60)
HEADINGS = 12
STEP = math.radians(30)
"""Angle between headings, and between elevations, radians."""


def heading_and_elevation(index: int) -> tuple[float, float]:
    """Heading and elevation of the view `index`, in radians: heading 0 is +y, positive turns right; positive elevation
    looks up."""
    return index % HEADINGS * STEP, (index // HEADINGS - 1) * STEP


def sweep(position: NDArray[np.floating], width: int = WIDTH, height: int = HEIGHT) -> list[Camera]:
    """The 36 cameras at `position` (3,), meters, world, in the order of viewIndex."""
    focal = height / 2 / math.tan(VFOV / 2)
    intrinsics = Intrinsics(width, height, focal, focal, width / 2, height / 2)
    at = np.asarray(position, np.float64)
    return [Camera(intrinsics, look(at, *heading_and_elevation(i))) for i in range(VIEWS)]
