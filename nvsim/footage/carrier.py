"""Find the carrier of a 360 degree camera in its panoramas: the person or the tripod below the camera.

The carrier is the unchanging region around the straight-down direction. Each pixel is compared with the others in its
row, which have equal elevation, because the floor changes less than furniture. A carrier sways, so a pixel may also
take the usual values of its neighbors.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from cv2.typing import MatLike
from numpy.typing import NDArray

from nvsim.capture.masks import decode_mask
from nvsim.capture.types import MaskFile
from nvsim.errors import InputError
from nvsim.footage.sources import is_equirectangular
from nvsim.footage.views import Views, covered_pixels, cut_views, join

_ROWS = 360  # height of the panoramas that are compared: a pixel is half a degree
_MOST, _FEWEST = 48, 12  # panoramas that are compared: at most, to bound the memory; at least, for a result
_HIGHEST = 20  # rows below the horizon where the search begins
_BLUR = 1.5  # pixels
_USUAL = 75  # percent of the panoramas in which a pixel of the carrier does not change
_CALM, _STEADY = 35, 0.4  # percentile of the changes in a row; largest change of the carrier over that value
_FADING = 0.98  # the expected change of a row is at least this share of that of the row above
_LEAST, _LARGEST = 0.004, 0.5  # limits of the carrier's share of the sphere below the highest row
_BORDER = 10  # pixels


def _disk(pixels: int) -> MatLike:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (pixels, pixels))


_SWAY = _disk(5)  # neighbors whose values a pixel of a swaying carrier may take
_GAP = _disk(9)  # narrower holes are closed, and narrower spikes are removed


class PanoramaSamples:
    """Collects a few dozen panoramas, evenly sampled from all that are added: small, gray, below the horizon.

    views  the layout of the views that are added, None if equirectangular images are added
    """

    def __init__(self, views: Views | None = None) -> None:
        self._views = views
        self._kept: list[NDArray[np.uint8]] = []
        self._added, self._every = 0, 1

    def add(self, panorama: NDArray[np.uint8] | list[NDArray[np.uint8]]) -> None:
        """Adds an equirectangular image (H, 2H, 3), or the views (S, S, 3) of one panorama, uint8 BGR."""
        if self._added % self._every == 0:
            if isinstance(panorama, list):
                assert self._views is not None
                panorama = join(panorama, self._views, _ROWS)
            small = cv2.resize(panorama, (2 * _ROWS, _ROWS), interpolation=cv2.INTER_AREA)
            self._kept.append(np.asarray(cv2.cvtColor(small[_ROWS // 2 :], cv2.COLOR_BGR2GRAY), np.uint8))
            if len(self._kept) > _MOST:
                self._kept, self._every = self._kept[::2], 2 * self._every
        self._added += 1

    def usable(self) -> NDArray[np.bool_] | None:
        """(H, 2H) bool, equirectangular, False where the panoramas show the carrier. None if no carrier is found."""
        if len(self._kept) < _FEWEST:
            return None
        below = np.array(self._kept)
        if self._views is not None:
            below = _extend_panoramas(below, covered_pixels(self._views, _ROWS)[_ROWS // 2 :])
        carrier = find_carrier(below)
        return None if carrier is None else np.concatenate([np.ones_like(carrier), ~carrier])


def find_carrier(below: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    """(R, 4R) bool mask of the carrier from the lower halves of gray panoramas `below` (N, R, 4R). None if no carrier
    is found. Pixels below a part of the carrier belong to it."""
    smooth = np.array(
        [_change_around_seam(panorama, lambda image: cv2.GaussianBlur(image, (0, 0), _BLUR)) for panorama in below]
    )
    middle = np.median(smooth, axis=0)
    low, high = (
        _change_around_seam(middle, lambda i: cv2.erode(i, _SWAY)),
        _change_around_seam(middle, lambda i: cv2.dilate(i, _SWAY)),
    )
    change = np.percentile(np.maximum(np.maximum(low - smooth, smooth - high), 0), _USUAL, axis=0)
    expected = np.percentile(change, _CALM, axis=1)
    for row in range(1, len(expected)):
        expected[row] = max(expected[row], _FADING * expected[row - 1])
    steady = change < _STEADY * expected[:, None]
    steady[:_HIGHEST] = False
    steady = _change_around_seam(steady, lambda image: cv2.morphologyEx(image, cv2.MORPH_CLOSE, _GAP)) > 0
    parts = cv2.connectedComponents(np.tile(steady, 2).astype(np.uint8))[1]  # two copies, so that the edges connect
    grounded = np.isin(parts, parts[-1][parts[-1] > 0])
    carrier = np.logical_or.accumulate(np.logical_or(*np.split(grounded, 2, axis=1)), axis=0)
    carrier = _change_around_seam(carrier, lambda image: cv2.morphologyEx(image, cv2.MORPH_OPEN, _GAP)) > 0
    weight = np.cos(np.pi / 2 * (np.arange(len(carrier)) + 0.5) / len(carrier))[_HIGHEST:]
    share = float(weight @ carrier[_HIGHEST:].mean(axis=1) / weight.sum())
    return carrier if _LEAST < share < _LARGEST else None


def _extend_panoramas(below: NDArray[np.uint8], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Extends panoramas (N, R, C): the last pixel of each column that the views show, `seen` (R, C), fills the rest."""
    last = seen.sum(axis=0) - 1  # views show each column from the horizon downward without a gap
    rows = np.minimum(np.arange(len(seen))[:, None], last)
    return below[:, rows, np.arange(seen.shape[1])]


def _change_around_seam(image: NDArray[np.generic], change: Callable[[MatLike], MatLike]) -> NDArray[np.float32]:
    """`change` of an image (R, C) whose left and right edges connect and whose last row repeats."""
    wrapped = np.pad(image.astype(np.float32), ((0, 0), (_BORDER, _BORDER)), mode="wrap")
    changed = change(np.pad(wrapped, ((0, _BORDER), (0, 0)), mode="edge"))
    return np.asarray(changed[:-_BORDER, _BORDER:-_BORDER], np.float32)


def read_panorama_mask(path: Path) -> NDArray[np.bool_]:
    """Reads a user's mask, (H, 2H) bool, False where the file is black. Raises InputError if it does not have the
    proportions of a panorama or ignores all pixels."""
    usable = decode_mask(MaskFile(path))
    height, width = usable.shape
    if not is_equirectangular(width, height):
        raise InputError(
            f"{path} is {width}x{height} pixels, but a mask of a panorama is twice as wide as high; save it in the "
            "size of the panoramas."
        )
    if not usable.any():
        raise InputError(f"{path} is all black, so it ignores all pixels; paint only the ignored part black.")
    return usable


def cut_mask(usable: NDArray[np.bool_], views: Views) -> list[NDArray[np.bool_]]:
    """The masks of all views, each (size, size) bool, from the mask `usable` (H, 2H)."""
    return [view > 0 for view in cut_views(np.where(usable, np.uint8(255), np.uint8(0)), views, nearest=True)]


def as_png(usable: NDArray[np.bool_]) -> bytes:
    """The PNG file content of a mask (H, W), in which ignored pixels are black."""
    return bytes(cv2.imencode(".png", np.where(usable, np.uint8(255), np.uint8(0)))[1])
