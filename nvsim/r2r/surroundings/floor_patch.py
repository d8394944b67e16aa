"""The floor around a viewpoint from straight above, as fine as its strip shows it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nvsim.graph.types import Viewpoint
from nvsim.r2r.observations.line_of_sight import strip_pixels

PIXEL = 0.02
"""Metres of a pixel of a patch: joints between tiles and planks are as wide."""
_HALF = 1.6  # metres from the middle to the sides; farther off joints run together
_OFF, _SLANTED = 0.06, 0.02  # metres that depth may be off the floor, and as many a metre of the ray


@dataclass(frozen=True, eq=False)
class FloorPatch:
    """low     (x, y) metres of the lower corner of pixel [0, 0]; rows follow y, columns x
    colours (G, G, 3) uint8, red, green, blue
    seen    (G, G) where it is the floor that is seen, and not what stands on it
    """

    low: tuple[float, float]
    colours: NDArray[np.uint8]
    seen: NDArray[np.bool_]


def floor_patch(viewpoint: Viewpoint, strip: NDArray[np.uint8], metres: NDArray[np.floating]) -> FloorPatch:
    """Of a viewpoint whose pose faces +y, level.

    strip   (S, 6 S, 3) red, green, blue
    metres  (S, 6 S) along the rays of its pixels, 0 where there is nothing
    """
    along = (np.arange(round(2 * _HALF / PIXEL)) + 0.5) * PIXEL - _HALF
    x, y = np.meshgrid(along, along)
    ways = np.stack([x, y, np.full_like(x, -viewpoint.height)], axis=-1).reshape(-1, 3)
    rows, columns = strip_pixels(ways, strip.shape[0])
    lengths = np.linalg.norm(ways, axis=1)
    seen = np.abs(metres[rows, columns] - lengths) <= _OFF + _SLANTED * lengths
    low = float(viewpoint.position[0]) - _HALF, float(viewpoint.position[1]) - _HALF
    return FloorPatch(low, strip[rows, columns].reshape(*x.shape, 3), seen.reshape(x.shape))
