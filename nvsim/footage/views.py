"""Level perspective views of a 360 degree panorama: where they look, and how they are cut.

An equirectangular image has a ray for each pixel: columns are longitudes from -180 to 180 degrees, rows latitudes from
90 to -90. Four square views of 90 degrees cover everything between 45 degrees above and below the horizon near their
middles, and about 35 degrees at their corners. Who carries the camera is below that.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

VIEWS = 4
LARGEST = 960
"""Pixels of the side of a view that is cut."""
_SHRUNK = 1.5  # times the resolution of the views, from which on a panorama is shrunk before it is cut


@dataclass(frozen=True)
class Views:
    """Square views of one panorama, side by side around the vertical axis.

    count  of the views, each 360 / count degrees wide; view 0 looks ahead, the next one to the right of it
    size   pixels of their sides
    """

    count: int
    size: int

    @property
    def focal(self) -> float:
        """Pixels."""
        return float(self.size / 2 / np.tan(np.pi / self.count))

    @property
    def turns(self) -> NDArray[np.float64]:
        """(count, 3, 3) view from panorama; axes of both are OpenCV's (x right, y down, z ahead)."""
        angles = 2 * np.pi / self.count * np.arange(self.count)
        turns = np.zeros((self.count, 3, 3))
        turns[:, 0, 0] = turns[:, 2, 2] = np.cos(angles)
        turns[:, 0, 2], turns[:, 2, 0] = -np.sin(angles), np.sin(angles)
        turns[:, 1, 1] = 1
        return turns

    def names(self, name: str) -> list[str]:
        """Where the views of a panorama called `name` are stored, below the folder of images."""
        return [f"side{k}/{name}" for k in range(self.count)]

    def resized(self, size: int) -> Views:
        """The same views with sides of `size` pixels."""
        return Views(self.count, size)


def views_of(height: int) -> Views:
    """The views into which a panorama of `height` pixels is cut: as fine as its horizon, and at most 960 pixels."""
    return Views(VIEWS, min(LARGEST, 2 * round(height / np.pi)))


def cut(panorama: NDArray[np.uint8], views: Views, nearest: bool = False) -> list[NDArray[np.uint8]]:
    """The views, (size, size) or (size, size, 3), of an equirectangular image (H, 2H) or (H, 2H, 3). `nearest` picks
    pixels rather than blending them, for masks."""
    width = 2 * np.pi * views.focal  # with as many pixels to the radian as the views have in their middles
    if not nearest and panorama.shape[1] > _SHRUNK * width:
        size = 2 * round(width / 2), round(width / 2)
        panorama = np.asarray(cv2.resize(panorama, size, interpolation=cv2.INTER_AREA), np.uint8)
    how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return [
        np.asarray(cv2.remap(panorama, x, y, how, borderMode=cv2.BORDER_WRAP), np.uint8)
        for x, y in _maps(panorama.shape[1], panorama.shape[0], views)
    ]


@lru_cache(maxsize=4)
def _maps(width: int, height: int, views: Views) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """For each view, the (size, size) columns and rows of a panorama that its pixels show."""
    places = (np.arange(views.size) + 0.5 - views.size / 2) / views.focal
    across, down = np.meshgrid(places, places)
    found = []
    for turn in views.turns:
        x, y, z = np.moveaxis(np.stack([across, down, np.ones_like(across)], axis=-1) @ turn, -1, 0)
        column = (np.arctan2(x, z) / (2 * np.pi) + 0.5) * width - 0.5
        row = (np.arctan2(y, np.hypot(x, z)) / np.pi + 0.5) * height - 0.5
        found.append((column.astype(np.float32), row.astype(np.float32)))
    return found
