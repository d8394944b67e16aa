"""Names in a project's cache of what the window makes for its frames, and masks as text. Knows no Qt."""

from __future__ import annotations

import base64
import hashlib
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.project.layout import Layout

THUMBNAIL = (160, 120)  # pixels, at least in one direction
COVERAGE = "coverage.json"


def thumbnail_path(layout: Layout, image_path: Path) -> Path:
    """By the image's own path, so that a capture that is imported anew finds its thumbnails again."""
    name = hashlib.sha1(str(image_path).encode("utf-8", "surrogateescape"), usedforsecurity=False).hexdigest()[:20]
    return layout.cache / "thumbnails" / f"{name}.jpg"


def packed(mask: NDArray[np.bool_]) -> str:
    """`mask` as a word of ASCII letters."""
    return base64.b64encode(zlib.compress(np.packbits(mask).tobytes(), 1)).decode()


def unpacked(word: str, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """What `packed` made of a mask of this shape."""
    bits = np.frombuffer(zlib.decompress(base64.b64decode(word)), np.uint8)
    return np.unpackbits(bits, count=shape[0] * shape[1]).reshape(shape).astype(bool)
