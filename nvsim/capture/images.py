"""Images of a capture: decoded strictly, undistorted and resampled to the pinhole that is asked for."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.raw import read_bytes
from nvsim.capture.types import Frame
from nvsim.errors import InputError
from nvsim.files.decoding import decoded, is_cut_off
from nvsim.files.image_size import image_size_of
from nvsim.geometry.camera import Intrinsics
from nvsim.geometry.lens import Lens

# The pose belongs to the pixels as stored; a viewer's orientation tag has no part in it.
_FLAGS = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
_AGAIN = "copy it again from the source"


def decode(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB as stored. Raises InputError naming the file when it is missing, empty, truncated, not an
    image, or not of the `size` (width, height) of its camera, where that is given. (Decoders fill what is missing with
    grey, so the end mark is looked for.)"""
    data = read_bytes(path)
    if is_cut_off(data):
        raise InputError(f"{path} is truncated (its end mark is missing); {_AGAIN}.")
    image = decoded(data, path, _FLAGS, size=size, then=_AGAIN)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def image_size(path: Path) -> tuple[int, int]:
    """Width and height in pixels as the header of the image gives them. Raises InputError when it cannot be read or is
    no image."""
    found = image_size_of(read_bytes(path))
    if found is None:
        raise InputError(f"{path} is not an image that can be decoded; {_AGAIN}.")
    return found.width, found.height


def read_image(frame: Frame, intrinsics: Intrinsics) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of `frame` as the pinhole `intrinsics` sees it: undistorted and resampled in one step, with
    area filtering when it shrinks. Raises InputError naming the file when it is missing, broken or of another size
    than its lens."""
    lens = frame.lens
    image = decode(frame.image_path, (lens.width, lens.height))
    height, width = image.shape[:2]
    size = (intrinsics.width, intrinsics.height)
    if not lens.is_distorted and _same_view(lens.pinhole.scaled(*size), intrinsics):
        if size == (width, height):
            return image
        shrinking = size[0] < width or size[1] < height
        return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_LINEAR))
    finer, mapping = sampling(lens, intrinsics)
    sampled = cv2.remap(image, mapping[..., 0], mapping[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    if finer == 1:
        return np.asarray(sampled)
    return np.asarray(cv2.resize(sampled, size, interpolation=cv2.INTER_AREA))


def _same_view(a: Intrinsics, b: Intrinsics) -> bool:
    return bool(np.allclose([a.fx, a.fy, a.cx, a.cy], [b.fx, b.fy, b.cx, b.cy], rtol=0, atol=1e-6))


@lru_cache(maxsize=4)
def sampling(lens: Lens, target: Intrinsics) -> tuple[int, NDArray[np.float32]]:
    """How many samples a side each pixel of `target` takes so that none of the stored image is stepped over, and the
    (H, W, 2) map of the samples."""
    ratio = min(lens.focal[0] / target.fx, lens.focal[1] / target.fy)
    finer = max(1, math.ceil(ratio - 1e-6))
    return finer, lens.undistort_map(target.scaled(target.width * finer, target.height * finer))
