"""The one place where images from outside are decoded: frames, masks, maps, images beside a graph.

The size is read from the header and compared with what is expected first, so that a small file cannot fill the memory.
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
"""Bytes that any file may take in memory. Beyond them it must be of the size that somebody announced, or take no more
than ten times its own length."""
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
    """The pixels of an image, (H, W) or (H, W, C) as OpenCV's `flags` ask for them (blue, green, red).

    data     the content of the file
    path     its name, for the messages
    size     (width, height) in pixels that it must have, and `size_of` what says so; None where nothing does
    what     what it should be, with its article
    then     what the user can do about a broken one

    Raises InputError, before anything is decoded, for a format that is not listed, another size than `size`, more than
    200 megapixels of 8 bytes, and more pixels than the file can hold; after that, for an image that is damaged.
    """
    import cv2

    found = image_size_of(data)
    if found is None or found.width <= 0 or found.height <= 0:
        raise InputError(f"{path} is not {what} that can be decoded ({_FORMATS} are read); {then}.")
    width, height = found.width, found.height
    if size is not None and (width, height) != size:
        raise InputError(
            f"{path} is {width}x{height} pixels but {size_of} is {size[0]}x{size[1]}; "
            f"resize the image or correct {size_of.removeprefix('its ')}."
        )
    if width * height > MOST_PIXELS or found.pixel_bytes > MOST_PIXEL_BYTES:
        raise InputError(
            f"{path} is {width}x{height} pixels of {found.pixel_bytes} bytes; at most {MOST_PIXELS // 10**6} "
            f"megapixels of {MOST_PIXEL_BYTES} bytes are read, so make it smaller."
        )
    each = {cv2.IMREAD_GRAYSCALE: 1, cv2.IMREAD_UNCHANGED: found.pixel_bytes}.get(flags, 3)
    unbacked = size is None and 2 * width * height * each > ANYWAY + 10 * len(data)  # twice, as whoever asks converts
    if len(data) < found.least_bytes or unbacked:
        raise InputError(f"{path} announces {width}x{height} pixels, too many for its {len(data)} bytes; {then}.")
    with reading(path, what, then):
        try:
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
        except cv2.error:
            image = None
        if image is None:
            raise InputError(f"{path} is not {what} that can be decoded; {then}.")
        return np.asarray(image)


def is_cut_off(data: bytes) -> bool:
    """Whether a JPEG or PNG ends before its image does. Decoders fill what is missing with grey, and say nothing."""
    if data.startswith(b"\xff\xd8"):
        return data.find(b"\xff\xd9", _start_of_scan(data)) < 0
    if data.startswith(b"\x89PNG"):
        return data.rfind(b"IEND") < 0
    return False


def _start_of_scan(data: bytes) -> int:
    """Where a JPEG's first scan begins: after the segments, whose thumbnails have end marks of their own."""
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
