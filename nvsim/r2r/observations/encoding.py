"""Encodes images as JPEG and PNG. Equal images give equal bytes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def jpeg(colour: NDArray[np.uint8], quality: int, whole_chroma: bool) -> bytes:
    """Encodes an RGB image (H, W, 3) uint8 as JPEG.

    With `whole_chroma`, the chroma is not subsampled (4:4:4). Otherwise it is 4:2:0, which is smaller, but colors bleed
    across the borders of 16-pixel blocks.
    """
    import cv2

    sampling = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444 if whole_chroma else cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    return _encoded(".jpg", colour[..., ::-1], options)


def png(pixels: NDArray[np.generic]) -> bytes:
    """Encodes one channel (H, W), or RGB (H, W, 3), with 8 or 16 bits, as PNG."""
    return _encoded(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels, [])


def _encoded(suffix: str, pixels: NDArray[np.generic], options: list[int]) -> bytes:
    import cv2

    return bytes(cv2.imencode(suffix, np.ascontiguousarray(pixels), options)[1].tobytes())
