"""Perspective views of a 360 degree panorama: their directions, cutting, and joining.

An equirectangular image has a ray for each pixel: columns are longitudes from -180 to 180 degrees, rows latitudes from
90 to -90. Four horizontal square views of 90 degrees cover all directions near the horizon: up to 45 degrees above and
below it at their centers, and up to about 35 degrees at their corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.footage.cut_options import TILTS, VIEWS

LARGEST = 960
"""Largest side of a view that is cut, pixels."""
_SHRUNK = 1.5  # resolution over that of the views above which a panorama is reduced before it is cut


@dataclass(frozen=True)
class Views:
    """Square views of one panorama, in rings around the vertical axis.

    around  views of a ring, each 360 / around degrees wide; view 0 looks ahead, the next one to the right of it
    size    side of a view, pixels
    tilts   elevation of the view centers in degrees, for each ring
    """

    around: int
    size: int
    tilts: tuple[float, ...] = (0.0,)

    @property
    def count(self) -> int:
        """The number of views of all rings."""
        return self.around * len(self.tilts)

    @property
    def focal(self) -> float:
        """Focal length of the views, pixels."""
        return float(self.size / 2 / np.tan(np.pi / self.around))

    @property
    def turns(self) -> NDArray[np.float64]:
        """(count, 3, 3) rotations from panorama to view. Both have OpenCV axes (x right, y down, z forward)."""
        angles = 2 * np.pi / self.around * np.arange(self.around)
        level = np.zeros((self.around, 3, 3))
        level[:, 0, 0] = level[:, 2, 2] = np.cos(angles)
        level[:, 0, 2], level[:, 2, 0] = -np.sin(angles), np.sin(angles)
        level[:, 1, 1] = 1
        rings = []
        for tilt in np.radians(self.tilts):
            up = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
            rings.append(up @ level)
        return np.concatenate(rings)

    def names(self, name: str) -> list[str]:
        """Paths of the views of a panorama called `name`, relative to the image folder."""
        return [f"side{k}/{name}" for k in range(self.count)]


def views_of(height: int, count: int = VIEWS) -> Views:
    """The `count` views into which a panorama of `height` pixels is cut. Their resolution is that of the panorama at
    the horizon, and their side at most 960 pixels."""
    return Views(4, min(LARGEST, 2 * round(height / np.pi)), TILTS[count])


def cut_views(panorama: NDArray[np.uint8], views: Views, nearest: bool = False) -> list[NDArray[np.uint8]]:
    """Cuts an equirectangular image (H, 2H) or (H, 2H, 3) into views of shape (size, size) or (size, size, 3), uint8.
    `nearest` selects the nearest pixel without interpolation, for masks."""
    width = 2 * np.pi * views.focal  # width with the angular resolution of the view centers
    if not nearest and panorama.shape[1] > _SHRUNK * width:
        size = 2 * round(width / 2), round(width / 2)
        panorama = np.asarray(cv2.resize(panorama, size, interpolation=cv2.INTER_AREA), np.uint8)
    how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
    return [
        np.asarray(cv2.remap(panorama, x, y, how, borderMode=cv2.BORDER_WRAP), np.uint8)
        for x, y in _maps(panorama.shape[1], panorama.shape[0], views)
    ]


def join(images: Sequence[NDArray[np.uint8]], views: Views, height: int) -> NDArray[np.uint8]:
    """The equirectangular image (height, 2 * height) or (height, 2 * height, 3) of views, black outside all views."""
    shape = (height, 2 * height, *images[0].shape[2:])
    panorama = np.zeros(shape, np.uint8)
    for image, (x, y) in zip(images, _inverse_maps(height, views), strict=True):
        seen = x >= 0
        panorama[seen] = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[seen]
    return panorama


def covered_pixels(views: Views, height: int) -> NDArray[np.bool_]:
    """(height, 2 * height) bool, the pixels of an equirectangular image that a view shows."""
    return np.any([x >= 0 for x, _ in _inverse_maps(height, views)], axis=0)


def nearest_pixels(views: Views) -> list[NDArray[np.bool_]]:
    """For each view, (size, size) bool: pixels whose direction is nearest to the center of this view. Views of several
    rings overlap, and each direction belongs to one view."""
    turns, places = views.turns, (np.arange(views.size) + 0.5 - views.size / 2) / views.focal
    across, down = np.meshgrid(places, places)
    rays = np.stack([across, down, np.ones_like(across)], axis=-1)
    return [np.argmax(rays @ turn @ turns[:, 2].T, axis=-1) == k for k, turn in enumerate(turns)]


@lru_cache(maxsize=4)
def _inverse_maps(height: int, views: Views) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """For each view, its columns and rows (height, 2 * height) for the pixels of a panorama; -1 if another view is
    nearer to their direction or no view shows it."""
    longitude, latitude = np.meshgrid(
        (np.arange(2 * height) + 0.5) / height * np.pi - np.pi, np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi
    )
    level = np.cos(latitude)
    rays = np.stack([np.sin(longitude) * level, -np.sin(latitude), np.cos(longitude) * level], axis=-1)
    turns = views.turns
    own = np.argmax(rays @ turns[:, 2].T, axis=-1)
    found = []
    for k, turn in enumerate(turns):
        x, y, z = np.moveaxis(rays @ turn.T, -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            column, row = (views.focal * part / z + views.size / 2 - 0.5 for part in (x, y))
        inside = (own == k) & (np.abs(np.stack([column, row]) - (views.size - 1) / 2) <= views.size / 2).all(axis=0)
        x, y = (np.where(inside, np.clip(part, 0, views.size - 1), -1) for part in (column, row))
        found.append((x.astype(np.float32), y.astype(np.float32)))
    return found


@lru_cache(maxsize=4)
def _maps(width: int, height: int, views: Views) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """For each view, the columns and rows of a panorama (size, size) for its pixels."""
    places = (np.arange(views.size) + 0.5 - views.size / 2) / views.focal
    across, down = np.meshgrid(places, places)
    found = []
    for turn in views.turns:
        x, y, z = np.moveaxis(np.stack([across, down, np.ones_like(across)], axis=-1) @ turn, -1, 0)
        column = (np.arctan2(x, z) / (2 * np.pi) + 0.5) * width - 0.5
        row = (np.arctan2(y, np.hypot(x, z)) / np.pi + 0.5) * height - 0.5
        found.append((column.astype(np.float32), row.astype(np.float32)))
    return found
