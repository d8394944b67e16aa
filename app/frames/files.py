"""File names of thumbnails and floor shares in the cache of a project, and masks encoded as text. Does not use Qt."""

from __future__ import annotations

import base64
import hashlib
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.project.layout import Layout

THUMBNAIL = (160, 120)  # minimum width and height of a thumbnail, pixels; the image may be smaller
COVERAGE = "coverage.json"


def thumbnail_path(layout: Layout, image_path: Path) -> Path:
    """The thumbnail file of an image. The name depends on the image path, so that a repeated import reuses it."""
    name = hashlib.sha1(str(image_path).encode("utf-8", "surrogateescape"), usedforsecurity=False).hexdigest()[:20]
    return layout.cache / "thumbnails" / f"{name}.jpg"


def packed(mask: NDArray[np.bool_]) -> str:
    """`mask` (H, W) bool as ASCII text: packed bits, deflated, base 64."""
    return base64.b64encode(zlib.compress(np.packbits(mask).tobytes(), 1)).decode()


def unpacked(word: str, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Decodes the result of `packed` to a mask of this `shape` (H, W), bool."""
    bits = np.frombuffer(zlib.decompress(base64.b64decode(word)), np.uint8)
    return np.unpackbits(bits, count=shape[0] * shape[1]).reshape(shape).astype(bool)
