"""Image features: SIFT keypoints (Lowe 2004), compared as RootSIFT (Arandjelovic and Zisserman 2012).

A network can replace SIFT; see FeatureFinder.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

MOST = 1000  # features of an image
_CONTRAST = 0.02
BORDER = 9
"""Pixels. Features within half of it of unusable pixels are skipped; the edge of a mask is no edge of the building."""
_RATIO = 0.8  # distance to the best match over the distance to the second best
_AT_ONCE = 256  # vectors that are compared with all others at once, so that the products stay in the processor's cache


@dataclass(frozen=True, eq=False)
class Features:
    """The features of an image, the most distinct first.

    places       (N, 2) float64, pixels; (0.5, 0.5) is the center of the first pixel
    descriptors  (N, 128) uint8 of SIFT, or (N, D) float16 unit vectors of a network. They are compact because the
                 descriptors of all images are in memory
    matcher      the network that matches these features, None if the nearest descriptors match
    size         width and height of the image in pixels, for the matcher
    """

    places: NDArray[np.float64]
    descriptors: NDArray[Any]
    matcher: Matcher | None = None
    size: tuple[int, int] = (0, 0)

    def __len__(self) -> int:
        return len(self.places)

    def most_distinct(self, most: int) -> Features:
        """The `most` distinct features."""
        return self.select(slice(most))

    def select(self, rows: slice | NDArray[np.int64]) -> Features:
        """The features at `rows`: a slice or indices (M,)."""
        return replace(self, places=self.places[rows], descriptors=self.descriptors[rows])


Matcher = Callable[[Features, Features], NDArray[np.int64]]
"""Function that gives the pairs (M, 2) int64 of features of two images."""


class FeatureFinder(Protocol):
    """Finds features in place of SIFT. `name` is its name for users."""

    name: str

    def find(self, image: NDArray[np.uint8], most: int, usable: NDArray[np.bool_] | None = None) -> Features:
        """The `most` distinct features of `image` (H, W, 3) uint8 RGB. `usable` (H, W) selects pixels; None
        uses all."""


NOTHING = Features(np.zeros((0, 2)), np.zeros((0, 128), np.uint8))


def find_features(
    image: NDArray[np.uint8],
    most: int = MOST,
    usable: NDArray[np.bool_] | None = None,
    contrast: float = _CONTRAST,
) -> Features:
    """Finds the features of `image` (H, W, 3) uint8 RGB. `usable` (H, W) selects pixels; None uses all pixels. A lower
    `contrast` finds more features on plain walls."""
    finder = cv2.SIFT.create(most, contrastThreshold=contrast)
    mask = None if usable is None else cv2.erode(usable.astype(np.uint8), np.ones((BORDER, BORDER), np.uint8))
    keys, found = finder.detectAndCompute(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), mask)
    if found is None or not len(keys):
        return NOTHING
    order = np.argsort([-key.response for key in keys], kind="stable")
    places = np.array([key.pt for key in keys], np.float64)[order] + 0.5
    return Features(places, np.clip(np.rint(found[order]), 0, 255).astype(np.uint8))


def match_features(one: Features, other: Features) -> NDArray[np.int64]:
    """(M, 2) int64 pairs of features of two images: those of their matcher. Without one, those that are each other's
    best match and clearly better than the second best."""
    if one.matcher is not None:
        return one.matcher(one, other)
    return match_descriptors(unit_vectors(one), unit_vectors(other), _RATIO)


def match_descriptors(
    one: NDArray[np.float32],
    other: NDArray[np.float32],
    ratio: float,
    allowed: Callable[[slice], NDArray[np.bool_]] | None = None,
) -> NDArray[np.int64]:
    """(M, 2) int64 pairs of unit vectors (N, D) that are each other's nearest, and nearer than `ratio` times the
    second nearest. `allowed` gives, for a slice of `one`, the vectors of `other` that are compared, (n, N2) bool; None
    compares all."""
    if len(one) < 2 or len(other) < 2:
        return np.zeros((0, 2), np.int64)
    count = len(one)
    best, first, second = np.zeros(count, np.int64), np.zeros(count, np.float32), np.zeros(count, np.float32)
    back, nearest = np.zeros(len(other), np.int64), np.full(len(other), -np.inf, np.float32)
    columns = np.ascontiguousarray(other.T)
    for start in range(0, count, _AT_ONCE):
        here = slice(start, start + _AT_ONCE)
        likeness = one[here] @ columns
        if allowed is not None:
            likeness[~allowed(here)] = -1
        rows = np.arange(len(likeness))
        best[here] = likeness.argmax(axis=1)
        first[here] = likeness[rows, best[here]]
        highest = likeness.max(axis=0)
        closer = highest > nearest
        nearest[closer] = highest[closer]
        back[closer] = start + likeness[:, closer].argmax(axis=0)
        likeness[rows, best[here]] = -1
        second[here] = likeness.max(axis=1)
    # For unit vectors, the squared distance is 2 minus twice the dot product.
    clear = (back[best] == np.arange(count)) & (first > -1) & (1 - first < ratio**2 * (1 - second))
    return np.stack([np.flatnonzero(clear), best[clear]], axis=1)


def unit_vectors(features: Features) -> NDArray[np.float32]:
    """(N, D) the descriptors as unit vectors. Those of SIFT become RootSIFT: square roots of the descriptors divided by
    their sums."""
    if features.descriptors.dtype != np.uint8:
        return features.descriptors.astype(np.float32)
    values = features.descriptors.astype(np.float32)
    return np.asarray(np.sqrt(values / np.maximum(values.sum(axis=1, keepdims=True), 1e-9)), np.float32)
