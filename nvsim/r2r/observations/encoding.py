"""Images as bytes of JPEG and PNG files, the same bytes for the same image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def jpeg(colour: NDArray[np.uint8], quality: int, whole_chroma: bool) -> bytes:
    """Red, green, blue (H, W, 3). With `whole_chroma` as 4:4:4, else as 4:2:0, which is smaller and bleeds colour over
    borders of 16 pixels."""
    import cv2

    sampling = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444 if whole_chroma else cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420
    options = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    return _encoded(".jpg", colour[..., ::-1], options)


def png(pixels: NDArray[np.generic]) -> bytes:
    """One channel (H, W), or red, green, blue (H, W, 3); 8 or 16 bits."""
    return _encoded(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels, [])


def _encoded(suffix: str, pixels: NDArray[np.generic], options: list[int]) -> bytes:
    import cv2

    return bytes(cv2.imencode(suffix, np.ascontiguousarray(pixels), options)[1].tobytes())
