"""Decodes images from files, and reads their size from their first bytes.

A compressed image of some kilobytes may unpack to gigabytes, so its size is checked before decoding.

Headers are not read with Pillow because size and orientation of 4,000 JPEG files then take 0.37 s instead of 0.14 s,
and of 4,000 PNG files 36 s instead of 0.19 s: Pillow decodes a PNG to find its orientation.

Formats of headers: PNG (W3C, chunk IHDR), JPEG (ITU T.81, B.2.2), Netpbm (netpbm.sourceforge.net/doc), WebP (RFC 9649),
TIFF 6.0, BMP (BITMAPINFOHEADER).
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading

_NAMES = {b"P1": 1, b"P2": 1, b"P3": 3, b"P4": 1, b"P5": 1, b"P6": 3}
_TOKEN = re.compile(rb"(?:\s|#[^\n]*\n)*(\d{1,10})")
_TIFF_SIZES = {1: 1, 3: 2, 4: 4}  # bytes of the integer field types of TIFF
_ONE_PIXEL_EACH = 1032  # deflate unpacks one byte to at most this number of bytes


@dataclass(frozen=True)
class ImageSize:
    """width, height  pixels
    pixel_bytes  bytes of a decoded pixel
    least_bytes  smallest possible length of a valid file of this size, 0 if the format gives no bound
    """

    width: int
    height: int
    pixel_bytes: int
    least_bytes: int = 0


def image_size_of(data: bytes) -> ImageSize | None:
    """The size in the header of an image, None if the format is not supported or the image has no pixels."""
    size = _size_in_header(data)
    return size if size is not None and size.width > 0 and size.height > 0 else None


def _size_in_header(data: bytes) -> ImageSize | None:
    try:
        if data.startswith(b"\x89PNG\r\n\x1a\n"):
            return _png(data)
        if data.startswith(b"\xff\xd8"):
            return _jpeg(data)
        if data[:2] in _NAMES:
            return _netpbm(data)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp(data)
        if data[:4] in (b"II*\0", b"MM\0*"):
            return _tiff(data)
        if data.startswith(b"BM"):
            return _bmp(data)
    except (struct.error, IndexError):
        return None  # the header is truncated
    return None


def orientation_of(data: bytes) -> int:
    """The Exif orientation of a JPEG or PNG, from 1 (as stored) to 8; 5 to 8 swap width and height. 1 if the image has
    no orientation."""
    try:
        if data.startswith(b"\xff\xd8"):
            return _orientation_in(_jpeg_exif(data))
        if data.startswith(b"\x89PNG\r\n\x1a\n"):
            return _orientation_in(_png_exif(data))
    except (struct.error, IndexError):
        pass  # the header is truncated
    return 1


def _jpeg_exif(data: bytes) -> bytes:
    """The TIFF structure in the first APP1 segment with Exif (Exif 3.0, 4.7.2); b"" without one."""
    at = 2
    while data[at] == 0xFF and data[at + 1] not in (0xD9, 0xDA):
        (length,) = struct.unpack_from(">H", data, at + 2)
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\0\0":
            return data[at + 10 : at + 2 + length]
        at += 2 + max(2, length)
    return b""


def _png_exif(data: bytes) -> bytes:
    at = 8
    while at + 8 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        if data[at + 4 : at + 8] == b"eXIf":
            return data[at + 8 : at + 8 + length]
        at += 12 + length
    return b""


def _orientation_in(exif: bytes) -> int:
    if exif[:4] not in (b"II*\0", b"MM\0*"):
        return 1
    order = "<" if exif[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", exif, 4)
    (count,) = struct.unpack_from(order + "H", exif, at)
    for i in range(count):
        tag, kind, number = struct.unpack_from(order + "HHI", exif, at + 2 + 12 * i)
        if tag == 0x0112 and kind == 3 and number == 1:
            (value,) = struct.unpack_from(order + "H", exif, at + 10 + 12 * i)
            return int(value) if 1 <= value <= 8 else 1
    return 1


def _says_too_much(data: bytes) -> bool:
    """Whether a chunk of a PNG claims more bytes than the file has. OpenCV would allocate this memory at once."""
    at = 8
    while at + 8 <= len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        if length > len(data) - at - 8:
            return True
        if data[at + 4 : at + 8] == b"IEND":
            return False
        at += 12 + length
    return False


def _png(data: bytes) -> ImageSize | None:
    if data[12:16] != b"IHDR":
        return None
    width, height, depth, kind = struct.unpack_from(">IIBB", data, 16)
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}.get(kind)
    if channels is None or depth not in (1, 2, 4, 8, 16) or _says_too_much(data):
        return None
    packed = height * (width * channels * depth // 8)
    decoded = 3 if kind == 3 else channels + (channels == 2) * 2
    return ImageSize(width, height, decoded * (2 if depth == 16 else 1), packed // _ONE_PIXEL_EACH)


def _jpeg(data: bytes) -> ImageSize | None:
    at = 2
    while True:
        at = data.find(b"\xff", at)
        while at >= 0 and data[at] == 0xFF:
            at += 1
        if at < 0:
            return None
        marker = data[at]
        at += 1
        if marker in (0x00, 0x01) or 0xD0 <= marker <= 0xD7:
            continue  # these have no length
        if marker in (0xD8, 0xD9, 0xDA):
            return None  # the image begins or ends before its size is given
        (length,) = struct.unpack_from(">H", data, at)
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            depth, height, width, channels = struct.unpack_from(">BHHB", data, at + 2)
            blocks = -(-width // 8) * -(-height // 8)
            return ImageSize(width, height, max(1, channels) * (2 if depth > 8 else 1), blocks // 8)
        at += max(2, length)


def _netpbm(data: bytes) -> ImageSize | None:
    numbers, at = [], 2
    for _ in range(2 if data[1:2] in b"14" else 3):
        found = _TOKEN.match(data, at, at + 4096)
        if found is None:
            return None
        numbers.append(int(found[1]))
        at = found.end()
    width, height, largest = (*numbers, 1)[:3]
    samples = width * height * _NAMES[data[:2]]
    deep = 2 if largest > 255 else 1
    least = {b"P1": samples, b"P4": -(-width // 8) * height, b"P2": 2 * samples - 1, b"P3": 2 * samples - 1}
    return ImageSize(width, height, _NAMES[data[:2]] * deep, at + least.get(data[:2], samples * deep))


def _webp(data: bytes) -> ImageSize | None:
    kind = data[12:16]
    if kind == b"VP8X":
        width, height = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
    elif kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        width, height = (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    elif kind == b"VP8 ":
        width, height = (v & 0x3FFF for v in struct.unpack_from("<HH", data, 26))
    else:
        return None
    return ImageSize(width, height, 4)


def _tiff(data: bytes) -> ImageSize | None:
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    tags: dict[int, int] = {}
    for i in range(count):
        tag, kind, number, _ = struct.unpack_from(order + "HHII", data, at + 2 + 12 * i)
        if kind in _TIFF_SIZES and number >= 1:
            inline = number * _TIFF_SIZES[kind] <= 4
            place = at + 10 + 12 * i if inline else struct.unpack_from(order + "I", data, at + 10 + 12 * i)[0]
            tags.setdefault(tag, struct.unpack_from(order + {1: "B", 3: "H", 4: "I"}[kind], data, place)[0])
    if not {256, 257} <= tags.keys():
        return None
    # A tile is decoded completely, even if only part of it belongs to the image.
    width, height = max(tags[256], tags.get(322, 0)), max(tags[257], tags.get(323, 0))
    return ImageSize(width, height, max(1, tags.get(277, 1)) * max(1, -(-tags.get(258, 1) // 8)))


def _bmp(data: bytes) -> ImageSize | None:
    (header,) = struct.unpack_from("<I", data, 14)
    if header == 12:
        width, height, _, depth = struct.unpack_from("<HHHH", data, 18)
        packing = 0
    else:
        width, height, _, depth, packing = struct.unpack_from("<iiHHI", data, 18)
    height = abs(height)
    least = height * (width * depth // 8) if packing in (0, 3) else 0
    return ImageSize(width, height, 4, max(0, least))


MOST_PIXELS = 200_000_000
MOST_PIXEL_BYTES = 8  # four channels of 16 bits
ANYWAY = 64_000_000
"""Bytes that any decoded image may take in memory. A larger image must have the size that the caller expects, or take
at most ten times the length of its file."""
_FORMATS = "PNG, JPEG, PGM, PPM, WebP, TIFF and BMP"


def decode_pixels(
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
