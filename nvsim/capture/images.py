"""Images of a capture: decoded strictly, undistorted and resampled to the pinhole that is asked for."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from nvsim.capture.raw import read_bytes
from nvsim.capture.types import Frame
from nvsim.errors import InputError
from nvsim.files.decoding import decoded, is_cut_off
from nvsim.files.image_size import image_size_of, orientation_of
from nvsim.files.regular import opened
from nvsim.geometry.camera import Intrinsics
from nvsim.geometry.lens import Lens

_HEAD = 1 << 16  # bytes in which most images give their size
_AGAIN = "copy it again from the source"


def decode(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB as stored, or as its orientation tag turns it where only that has the `size` (width, height)
    of its camera, where that is given. Raises InputError naming the file when it is missing, empty, truncated, not an
    image, or of neither size. (Decoders fill what is missing with grey, so the end mark is looked for.)"""
    data = read_bytes(path)
    if is_cut_off(data):
        raise InputError(f"{path} is truncated (its end mark is missing); {_AGAIN}.")
    image = decode_for_camera(data, path, cv2.IMREAD_COLOR, size)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def decode_for_camera(data: bytes, path: Path, flags: int, size: tuple[int, int] | None) -> NDArray[np.uint8]:
    """(H, W, 3) BGR of the image `data` with OpenCV's `flags`, for a camera of `size` (width, height).

    The pose belongs to the pixels as stored, so an orientation tag is not followed. Some programs turn photos before
    they measure cameras, though: where the stored image has width and height swapped and the tag turns it by a
    quarter, it is turned. Raises InputError as `decoded` does."""
    flags |= cv2.IMREAD_IGNORE_ORIENTATION
    found = image_size_of(data)
    turn = orientation_of(data)
    if size is None or found is None or not is_turned((found.width, found.height), turn, size):
        return decoded(data, path, flags, size=size, then=_AGAIN)
    image = decoded(data, path, flags, size=(size[1], size[0]), then=_AGAIN)
    return np.ascontiguousarray(_TURNS[turn](image))


_TURNS: dict[int, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
    5: lambda image: image.transpose(1, 0, 2),
    6: lambda image: np.rot90(image, -1),
    7: lambda image: np.rot90(image, 2).transpose(1, 0, 2),
    8: lambda image: np.rot90(image, 1),
}
"""Exif orientation -> the turn that shows the image upright (H, W, 3)."""


def is_turned(stored: tuple[int, int], orientation: int, size: tuple[int, int]) -> bool:
    """Whether an image whose file is `stored` (width, height) fits a camera of `size` only as its Exif `orientation`
    turns it."""
    return orientation in _TURNS and stored != size and stored == (size[1], size[0])


def image_header(path: Path) -> tuple[int, int, int] | None:
    """Width and height in pixels and Exif orientation in the header of the image, None where it cannot be read."""
    try:
        with opened(path) as file:
            data = file.read(_HEAD) or b""
        if data.startswith(b"\x89PNG"):  # a chunk that ends beyond what was read is not a fault
            found = image_size_of(data[:33])
        else:
            found = image_size_of(data) or image_size_of(read_bytes(path))
    except (InputError, OSError):
        return None
    return None if found is None else (found.width, found.height, orientation_of(data))


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
