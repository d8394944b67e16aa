"""Writes a panorama as image files: colors as JPEG or PNG, and the other channels as PNG files beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.render.types import RenderOutput

_JPEG = (".jpg", ".jpeg")


def write_panorama(path: Path, image: RenderOutput, unseen: NDArray[np.bool_] | None = None) -> list[Path]:
    """Writes rgb (H, W, 3) to `path` (.jpg or .png), and the other channels that `image` has to files beside it:

    NAME_alpha.png   8 bits, 0 to 1
    NAME_depth.png   16 bits, millimeters, 65.535 m at most, 0 if there is none
    NAME_normal.png  8 bits, red is x, green y, blue z, each from -1 to 1
    NAME_unseen.png  8 bits, 255 where `unseen` (H, W) is True, which means that no training image shows the surface

    JPEG files have no chroma subsampling, which would bleed over the borders of a strip of faces.

    Returns the written paths. Raises InputError for another suffix, and if a file cannot be written.
    """
    if path.suffix.lower() not in (*_JPEG, ".png"):
        raise InputError(f"{path} is not the name of an image file; give it the suffix .jpg or .png.")
    written: list[Path] = []
    if image.rgb is not None:
        _write(path, _bytes(image.rgb)[..., ::-1])
        written.append(path)
    others: dict[str, NDArray[np.generic]] = {}
    if image.alpha is not None:
        others["alpha"] = _bytes(image.alpha)
    if image.depth is not None:
        others["depth"] = np.round(np.clip(image.depth * 1000, 0, 65535)).astype(np.uint16)
    if image.normal is not None:
        others["normal"] = _bytes(image.normal / 2 + 0.5)[..., ::-1]
    if unseen is not None:
        others["unseen"] = np.where(unseen, 255, 0).astype(np.uint8)
    for name, pixels in others.items():
        beside = path.with_name(f"{path.stem}_{name}.png")
        _write(beside, pixels)
        written.append(beside)
    return written


def _bytes(values: NDArray[np.floating]) -> NDArray[np.uint8]:
    return np.round(np.clip(values, 0, 1) * 255).astype(np.uint8)


def _write(path: Path, pixels: NDArray[np.generic]) -> None:
    import cv2

    options: list[int] = []
    if path.suffix.lower() in _JPEG:
        subsampling = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
        options = [cv2.IMWRITE_JPEG_QUALITY, 95, *subsampling]
    encoded = cv2.imencode(path.suffix, np.ascontiguousarray(pixels), options)[1]
    atomic.write_bytes(path, encoded.tobytes())
