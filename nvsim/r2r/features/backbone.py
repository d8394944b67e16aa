"""Backbones, which compute features of views: their interface, the fallback without a network, and the fit to a layout.

A backbone is a user's network, the bundled trunk, or a fixed projection of colors and edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Float32 = NDArray[np.float32]
SEED = 0
_COLORS = (16, 12)  # columns and rows of cells
_EDGES = (8, 6)
_FINE = (64, 48)  # size in pixels of the image in which edges are computed
_DIRECTIONS = 8
_NUMBERS = _COLORS[0] * _COLORS[1] * 3 + _EDGES[0] * _EDGES[1] * _DIRECTIONS


class Backbone(Protocol):
    """Computes the features of images.

    name     name of the backbone, stored in the features file
    width    numbers in a row
    tokens   rows for each image: 1, or more if a layout needs the patches
    classes  number of ImageNet logits after the rows: 0 or 1000
    batch    largest number of images per call
    digest   hexadecimal; backbones with equal digests compute equal features
    """

    name: str
    width: int
    tokens: int
    classes: int
    batch: int
    digest: str

    def prepared(self, image: Image) -> NDArray[Any]:
        """Prepares an image (H, W, 3) uint8, RGB, as input. The result has a fixed shape for images of any size.

        May be called from several threads.
        """
        ...

    def features(self, images: Sequence[NDArray[Any]]) -> Float32:
        """Returns (N, tokens * width + classes) float32 for N prepared images; N is at most `batch`."""
        ...


class Width:
    """Converts rows from `given` to `wanted` numbers.

    Narrow rows are padded with zeros. Wide rows are projected onto fixed orthogonal directions, which preserves
    distances on average.

    words  description of the conversion, stored in the features file
    """

    def __init__(self, given: int, wanted: int) -> None:
        self._zeros = max(0, wanted - given)
        self._onto: Float32 | None = None
        self.words = "the backbone's own"
        if wanted > given:
            self.words = f"{given} of the backbone, followed by {self._zeros} zeros"
        elif wanted < given:
            self.words = f"{given} of the backbone, projected onto {wanted} fixed orthogonal directions (seed {SEED})"
            self._onto = _orthogonal(given, wanted)

    def __call__(self, rows: Float32) -> Float32:
        """Returns (N, wanted) float32 for `rows` (N, given)."""
        if self._onto is not None:
            return np.asarray(rows @ self._onto, np.float32)
        return np.pad(rows, ((0, 0), (0, self._zeros))) if self._zeros else rows


def _orthogonal(given: int, wanted: int) -> Float32:
    """Returns (given, wanted) orthonormal columns times sqrt(given / wanted), which preserves lengths on average."""
    q, r = np.linalg.qr(np.random.default_rng(SEED).standard_normal((given, wanted)))
    return np.asarray(q * np.sign(np.diag(r)) * np.sqrt(given / wanted), np.float32)


class Projection:
    """A Backbone of any `width`: the colors of 16 x 12 cells and edge-direction histograms of 8 x 6 cells.

    They are multiplied by a random Gaussian matrix with a fixed seed, so similar views have similar features.
    """

    def __init__(self, width: int) -> None:
        self.name = f"random projection of colours and edges (no trained network), seed {SEED}"
        self.width, self.tokens, self.classes, self.batch = width, 1, 0, 36
        self.digest = f"projection 1 {width} {SEED}"
        mixture = np.random.default_rng(SEED).standard_normal((_NUMBERS, width)) / np.sqrt(_NUMBERS)
        self._mixture = mixture.astype(np.float32)

    def prepared(self, image: Image) -> Float32:
        """Returns (960,): colors from -1 to 1, then the histograms, each with a norm of at most 1."""
        import cv2

        small = np.asarray(cv2.resize(image, _FINE, interpolation=cv2.INTER_AREA))
        colors = np.asarray(cv2.resize(small, _COLORS, interpolation=cv2.INTER_AREA), np.float32) / 127.5 - 1
        gray = np.asarray(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY), np.float32)
        across, down = (np.asarray(cv2.Sobel(gray, cv2.CV_32F, *d, ksize=3)) for d in ((1, 0), (0, 1)))
        strength = np.hypot(across, down)
        # Edges have no sign: directions half a turn apart are equal.
        direction = np.floor(np.mod(np.arctan2(down, across), np.pi) / np.pi * _DIRECTIONS).astype(np.int64)
        rows, columns = np.indices(gray.shape)
        cell = rows * _EDGES[1] // _FINE[1] * _EDGES[0] + columns * _EDGES[0] // _FINE[0]
        bins = cell * _DIRECTIONS + np.minimum(direction, _DIRECTIONS - 1)
        edges = np.bincount(bins.ravel(), strength.ravel(), _EDGES[0] * _EDGES[1] * _DIRECTIONS)
        cells = edges.reshape(-1, _DIRECTIONS)
        cells = cells / (np.linalg.norm(cells, axis=1, keepdims=True) + 100)
        return np.concatenate([colors.ravel(), cells.ravel().astype(np.float32)])

    def features(self, images: Sequence[NDArray[Any]]) -> Float32:
        """Returns (N, width) float32 of N prepared images (960,)."""
        return np.asarray(np.stack(images) @ self._mixture, np.float32)
