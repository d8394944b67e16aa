"""Decodes images from files: frames, masks, maps, and images beside a graph.

The size in the header is compared with the expected size before decoding, so that a small file cannot fill the memory.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.image_size import image_size_of
from nvsim.files.reading import reading

MOST_PIXELS = 200_000_000
MOST_PIXEL_BYTES = 8  # four channels of 16 bits
ANYWAY = 64_000_000
"""Bytes that any decoded image may take in memory. A larger image must have the size that the caller expects, or take
at most ten times the length of its file."""
_FORMATS = "PNG, JPEG, PGM, PPM, WebP, TIFF and BMP"


def decoded(
    data: bytes,
    path: Path,
    flags: int,
    *,
    size: tuple[int, int] | None = None,
    size_of: str = "its camera",
    what: str = "an image",
    then: str = "copy it again from the source",
) -> NDArray[Any]:
    """The pixels of an image, (H, W) or (H, W, C), uint8 or uint16, in OpenCV's order blue, green, red.

    data     the content of the file
    path     its name, for error messages
    flags    OpenCV's `IMREAD_` flags, which define the number of channels
    size     the required (width, height) in pixels, None if any size is allowed
    size_of  the source of `size`, for error messages
    what     the kind of file, with its article
    then     the advice to the user if the image is broken

    Raises InputError before decoding if the format is not supported, the size differs from `size`, the image has more
    than 200 megapixels or more than 8 bytes per pixel, or the file is too small for its pixels. Raises InputError after
    decoding if the image is damaged.
    """
    import cv2

    found = image_size_of(data)
    if found is None or found.width <= 0 or found.height <= 0:
        raise InputError(f"{path} is not {what} that can be decoded ({_FORMATS} are supported); {then}.")
    width, height = found.width, found.height
    if size is not None and (width, height) != size:
        raise InputError(
            f"{path} is {width}x{height} pixels but {size_of} is {size[0]}x{size[1]}; "
            f"resize the image or correct {size_of.removeprefix('its ')}."
        )
    if width * height > MOST_PIXELS or found.pixel_bytes > MOST_PIXEL_BYTES:
        raise InputError(
            f"{path} is {width}x{height} pixels of {found.pixel_bytes} bytes; the limit is {MOST_PIXELS // 10**6} "
            f"megapixels of {MOST_PIXEL_BYTES} bytes, so reduce its size."
        )
    each = {cv2.IMREAD_GRAYSCALE: 1, cv2.IMREAD_UNCHANGED: found.pixel_bytes}.get(flags, 3)
    unbacked = size is None and 2 * width * height * each > ANYWAY + 10 * len(data)  # twice, because callers convert it
    if len(data) < found.least_bytes or unbacked:
        raise InputError(f"{path} claims {width}x{height} pixels, too many for its {len(data)} bytes; {then}.")
    with reading(path, what, then):
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        except cv2.error:
            image = None
        if image is None:
            raise InputError(f"{path} is not {what} that can be decoded; {then}.")
        return np.asarray(image)


def is_cut_off(data: bytes) -> bool:
    """Whether a JPEG or PNG ends before its image does. Decoders fill the rest with gray and report no error."""
    if data.startswith(b"\xff\xd8"):
        return data.find(b"\xff\xd9", _start_of_scan(data)) < 0
    if data.startswith(b"\x89PNG"):
        return data.rfind(b"IEND") < 0
    return False


def _start_of_scan(data: bytes) -> int:
    """Offset of a JPEG's first scan: after the segments, because thumbnails in them have their own end markers."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        if data[at + 1] == 0xFF:
            at += 1
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if data[at + 1] == 0xDA or length < 2:
            return at + 2
        at += 2 + length
    return len(data)
