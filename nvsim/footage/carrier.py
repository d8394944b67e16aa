"""Find the carrier of a 360 degree camera in its panoramas: the person or the tripod below it.

The carrier is the region, connected with the direction straight down, that stays the same while the camera moves. Each
pixel is compared with the others of its row, which have the same elevation, because floor changes less than furniture.
A carrier sways, so a pixel may also take the values that its neighbors usually have.
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
from nvsim.footage.views import Views, covered, cut, join

_ROWS = 360  # of the panoramas that are compared: a pixel is half a degree
_MOST, _FEWEST = 48, 12  # panoramas that are compared, which bounds the memory; fewer are no evidence
_HIGHEST = 20  # rows below the horizon, from which on a carrier is looked for
_BLUR = 1.5  # pixels
_USUAL = 75  # percent of the panoramas in which a pixel of the carrier stays the same
_CALM, _STEADY = 35, 0.4  # percentile of the changes in a row, and the share of it that a carrier changes at most
_FADING = 0.98  # of the change in a row is expected in the next one, even if the carrier fills that one
_LEAST, _LARGEST = 0.004, 0.5  # of the sphere below the highest row: a carrier covers more, and less
_BORDER = 10  # pixels


def _disk(pixels: int) -> MatLike:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (pixels, pixels))


_SWAY = _disk(5)  # neighbors whose values a pixel of a swaying carrier takes
_GAP = _disk(9)  # narrower holes are closed, and narrower spikes removed


class PanoramaSamples:
    """A few dozen panoramas, evenly chosen from all that were added: small, gray, below the horizon.

    views  the views that are added, None if equirectangular images are added
    """

    def __init__(self, views: Views | None = None) -> None:
        self._views = views
        self._kept: list[NDArray[np.uint8]] = []
        self._added, self._every = 0, 1

    def add(self, panorama: NDArray[np.uint8] | list[NDArray[np.uint8]]) -> None:
        """An equirectangular image (H, 2H, 3), or the views (S, S, 3) of one panorama, uint8 BGR."""
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
        """(H, 2H) equirectangular, False where the panoramas show the carrier; None if no carrier is found."""
        if len(self._kept) < _FEWEST:
            return None
        below = np.array(self._kept)
        if self._views is not None:
            below = _continued(below, covered(self._views, _ROWS)[_ROWS // 2 :])
        carrier = find_carrier(below)
        return None if carrier is None else np.concatenate([np.ones_like(carrier), ~carrier])


def find_carrier(below: NDArray[np.uint8]) -> NDArray[np.bool_] | None:
    """(R, 4R) where the lower halves of gray panoramas (N, R, 4R) show the carrier; None if no carrier is found. Pixels
    below a part of the carrier belong to it."""
    smooth = np.array([_around(panorama, lambda image: cv2.GaussianBlur(image, (0, 0), _BLUR)) for panorama in below])
    middle = np.median(smooth, axis=0)
    low, high = _around(middle, lambda i: cv2.erode(i, _SWAY)), _around(middle, lambda i: cv2.dilate(i, _SWAY))
    change = np.percentile(np.maximum(np.maximum(low - smooth, smooth - high), 0), _USUAL, axis=0)
    expected = np.percentile(change, _CALM, axis=1)
    for row in range(1, len(expected)):
        expected[row] = max(expected[row], _FADING * expected[row - 1])
    steady = change < _STEADY * expected[:, None]
    steady[:_HIGHEST] = False
    steady = _around(steady, lambda image: cv2.morphologyEx(image, cv2.MORPH_CLOSE, _GAP)) > 0
    parts = cv2.connectedComponents(np.tile(steady, 2).astype(np.uint8))[1]  # twice around, so that the edges meet
    grounded = np.isin(parts, parts[-1][parts[-1] > 0])
    carrier = np.logical_or.accumulate(np.logical_or(*np.split(grounded, 2, axis=1)), axis=0)
    carrier = _around(carrier, lambda image: cv2.morphologyEx(image, cv2.MORPH_OPEN, _GAP)) > 0
    weight = np.cos(np.pi / 2 * (np.arange(len(carrier)) + 0.5) / len(carrier))[_HIGHEST:]
    share = float(weight @ carrier[_HIGHEST:].mean(axis=1) / weight.sum())
    return carrier if _LEAST < share < _LARGEST else None


def _continued(below: NDArray[np.uint8], seen: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Panoramas (N, R, C) in which the last pixel of each column that views show, `seen` (R, C), fills the rest."""
    last = seen.sum(axis=0) - 1  # views show each column from the horizon downward without a gap
    rows = np.minimum(np.arange(len(seen))[:, None], last)
    return below[:, rows, np.arange(seen.shape[1])]


def _around(image: NDArray[np.generic], change: Callable[[MatLike], MatLike]) -> NDArray[np.float32]:
    """`change` of an image (R, C) whose left and right edges meet and whose last row repeats."""
    wrapped = np.pad(image.astype(np.float32), ((0, 0), (_BORDER, _BORDER)), mode="wrap")
    changed = change(np.pad(wrapped, ((0, _BORDER), (0, 0)), mode="edge"))
    return np.asarray(changed[:-_BORDER, _BORDER:-_BORDER], np.float32)


def read_panorama_mask(path: Path) -> NDArray[np.bool_]:
    """(H, 2H) False where the mask of a user is black. Raises InputError if it has other proportions than a panorama or
    ignores everything."""
    usable = decode_mask(MaskFile(path))
    height, width = usable.shape
    if not is_equirectangular(width, height):
        raise InputError(
            f"{path} is {width}x{height} pixels, but a mask of a panorama is twice as wide as high; save it in the "
            "size of the panoramas."
        )
    if not usable.any():
        raise InputError(f"{path} is all black, so it ignores everything; paint only the ignored part black.")
    return usable


def cut_mask(usable: NDArray[np.bool_], views: Views) -> list[NDArray[np.bool_]]:
    """The (size, size) masks of all views."""
    return [view > 0 for view in cut(np.where(usable, np.uint8(255), np.uint8(0)), views, nearest=True)]


def as_png(usable: NDArray[np.bool_]) -> bytes:
    """A mask as the content of a file in which black is ignored."""
    return bytes(cv2.imencode(".png", np.where(usable, np.uint8(255), np.uint8(0)))[1])
