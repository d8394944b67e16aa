"""Images of a capture: strict decoding, undistortion, and resampling to a given pinhole camera."""

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
from nvsim.files.images import decode_pixels, image_size_of, is_cut_off, orientation_of
from nvsim.files.opening import opened
from nvsim.geometry.camera import Intrinsics
from nvsim.geometry.lens import Lens

_HEAD = 1 << 16  # bytes; most images store their size within them
_AGAIN = "copy it again from the source"


def decode(path: Path, size: tuple[int, int] | None = None) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB as stored. `size` is the expected (width, height) of the camera, None for any.

    If only the rotation in the orientation tag gives `size`, the image is rotated. Raises InputError naming the file if
    it is missing, empty, truncated, not an image, or does not have `size` in either way. (Decoders fill missing data
    with gray, so the end mark of the file is checked.)"""
    data = read_bytes(path)
    if is_cut_off(data):
        raise InputError(f"{path} is truncated (its end mark is missing); {_AGAIN}.")
    image = decode_for_camera(data, path, cv2.IMREAD_COLOR, size)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def decode_for_camera(data: bytes, path: Path, flags: int, size: tuple[int, int] | None) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 BGR of the image `data`, decoded with OpenCV's `flags`, for a camera of `size` (width, height).

    The pose belongs to the pixels as stored, so orientation tags are normally ignored. However, some programs rotate
    photos before they estimate cameras. If the stored width and height are swapped and the tag rotates the image by a
    quarter turn, it is rotated. Raises InputError as `decoded` does."""
    flags |= cv2.IMREAD_IGNORE_ORIENTATION
    found = image_size_of(data)
    turn = orientation_of(data)
    if size is None or found is None or not is_turned((found.width, found.height), turn, size):
        return decode_pixels(data, path, flags, size=size, then=_AGAIN)
    image = decode_pixels(data, path, flags, size=(size[1], size[0]), then=_AGAIN)
    return np.ascontiguousarray(_TURNS[turn](image))


_TURNS: dict[int, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
    5: lambda image: image.transpose(1, 0, 2),
    6: lambda image: np.rot90(image, -1),
    7: lambda image: np.rot90(image, 2).transpose(1, 0, 2),
    8: lambda image: np.rot90(image, 1),
}
"""Exif orientation -> function that rotates an image (H, W, 3) upright."""


def is_turned(stored: tuple[int, int], orientation: int, size: tuple[int, int]) -> bool:
    """Whether an image stored with size `stored` (width, height) fits a camera of `size` only if its Exif `orientation`
    is applied."""
    return orientation in _TURNS and stored != size and stored == (size[1], size[0])


def image_header(path: Path) -> tuple[int, int, int] | None:
    """Width and height in pixels and Exif orientation from the header of the image; None if it cannot be read."""
    try:
        with opened(path) as file:
            data = file.read(_HEAD) or b""
        if data.startswith(b"\x89PNG"):  # a chunk that ends after the bytes read so far is not a fault
            found = image_size_of(data[:33])
        else:
            found = image_size_of(data) or image_size_of(read_bytes(path))
    except (InputError, OSError):
        return None
    return None if found is None else (found.width, found.height, orientation_of(data))


def image_size(path: Path) -> tuple[int, int]:
    """Width and height in pixels from the header of the image. Raises InputError if it cannot be read or is not an
    image."""
    found = image_size_of(read_bytes(path))
    if found is None:
        raise InputError(f"{path} is not an image that can be decoded; {_AGAIN}.")
    return found.width, found.height


def read_image(frame: Frame, intrinsics: Intrinsics) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 RGB of `frame`, upright, in the view of the pinhole `intrinsics`.

    Undistortion and resampling are one step, with area filtering if the image shrinks. Raises InputError naming the
    file if it is missing, damaged, or not of the size of its lens."""
    lens = frame.lens
    image = decode(frame.image_path, (lens.width, lens.height))
    size = (intrinsics.width, intrinsics.height)
    if not lens.is_distorted and _same_view(lens.pinhole.scaled(*size), intrinsics):
        image = np.ascontiguousarray(lens.upright(image))
        height, width = image.shape[:2]
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
    """Samples per side for each pixel of `target`, and their (H, W, 2) float32 positions in the stored image.

    H and W are the size of `target` times the samples per side, chosen so that no stored pixel is skipped."""
    fx, fy = lens.focal if lens.turns % 2 == 0 else lens.focal[::-1]
    ratio = min(fx / target.fx, fy / target.fy)
    finer = max(1, math.ceil(ratio - 1e-6))
    return finer, lens.undistort_map(target.scaled(target.width * finer, target.height * finer))
