"""The floor around a viewpoint seen from above, at the resolution of its strip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Viewpoint
from nvsim.r2r.observations.skybox import strip_pixels

PIXEL = 0.02
"""Size of a patch pixel in meters, about the width of joints between tiles and planks."""
_HALF = 1.6  # half side of a patch in meters; joints are not resolved at larger distances
_OFF, _SLANTED = 0.06, 0.02  # tolerance of the floor depth: meters, and meters per meter of the ray


@dataclass(frozen=True, eq=False)
class FloorPatch:
    """A square image of the floor.

    low     (x, y) meters of the lower corner of pixel [0, 0]; rows follow y, columns x
    colours (G, G, 3) uint8, RGB
    seen    (G, G) bool, whether the pixel shows the floor and not an object on it
    """

    low: tuple[float, float]
    colours: NDArray[np.uint8]
    seen: NDArray[np.bool_]


def floor_patch(viewpoint: Viewpoint, strip: NDArray[np.uint8], metres: NDArray[np.floating]) -> FloorPatch:
    """Returns the floor patch of a viewpoint with a level pose facing +y.

    strip   (S, 6 S, 3) uint8 RGB
    metres  (S, 6 S) distances in meters along the rays, 0 if there is no surface
    """
    along = (np.arange(round(2 * _HALF / PIXEL)) + 0.5) * PIXEL - _HALF
    x, y = np.meshgrid(along, along)
    ways = np.stack([x, y, np.full_like(x, -viewpoint.height)], axis=-1).reshape(-1, 3)
    rows, columns = strip_pixels(ways, strip.shape[0])
    lengths = np.linalg.norm(ways, axis=1)
    seen = np.abs(metres[rows, columns] - lengths) <= _OFF + _SLANTED * lengths
    low = float(viewpoint.position[0]) - _HALF, float(viewpoint.position[1]) - _HALF
    return FloorPatch(low, strip[rows, columns].reshape(*x.shape, 3), seen.reshape(x.shape))
