"""The interface of backbones, which compute features of views: a user's network, the bundled trunk, or a projection."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Float32 = NDArray[np.float32]


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
