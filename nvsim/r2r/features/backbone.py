"""What turns a view into numbers: a network that the user brings, the bundled trunk, or a projection."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Float32 = NDArray[np.float32]


class Backbone(Protocol):
    """name     what the file says made it
    width    numbers of a row
    tokens   rows of an image: 1, or the patches too where a layout wants them
    classes  logits of ImageNet's classes behind them: 0 or 1000
    batch    images that go through at once
    digest   hexadecimal; two backbones with the same one give the same numbers
    """

    name: str
    width: int
    tokens: int
    classes: int
    batch: int
    digest: str

    def prepared(self, image: Image) -> NDArray[Any]:
        """What goes in of an image (H, W, 3) uint8, red, green, blue; of one size for images of all sizes. May run in
        several threads."""
        ...

    def features(self, images: Sequence[NDArray[Any]]) -> Float32:
        """(N, tokens * width + classes) of N prepared images, at most `batch`."""
        ...
