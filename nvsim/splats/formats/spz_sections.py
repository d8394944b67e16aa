"""Read and decode the sections of an SPZ file as a stream (nianticlabs/spz, load-spz.cc).

Versions 1 to 3 have a header of 16 bytes followed by the sections; the whole file may be gzipped. Version 4 has a
header of 32 bytes, a table of (compressed, uncompressed) sizes, and a zstd stream for each section that is not empty.
The sections are positions, alphas, colors, scales, rotations and harmonics. Each contains the values of all Gaussians.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import size_of
from nvsim.splats.formats.cleaning import ROWS
from nvsim.splats.types import Gaussians

MAGIC = 0x5053474E
ANTIALIASED = 1
"""The bit of the header's flags for antialiasing."""
_HEADER = struct.Struct("<IIIBBBB")
_LONG_HEADER = 32
_MOST_BITS = 24
_STREAMED = 4
"""First version in which sections are separate streams."""
_MOST_AFTER = 1 << 24
"""Largest number of bytes of extensions after the sections."""
_CHUNK = 1 << 16
_LEAST_ALPHA = np.float32(1e-6)
_COLOR_SCALE = np.float32(0.15)
Bytes = NDArray[np.uint8]


@dataclass(frozen=True)
class Header:
    """The header: number of Gaussians, degree of the harmonics, and number of fractional bits of positions."""

    version: int
    count: int
    degree: int
    bits: int
    flags: int

    @property
    def widths(self) -> tuple[int, ...]:
        """Bytes per Gaussian in each section."""
        position = 6 if self.version == 1 else 9
        rotation = 4 if self.version >= 3 else 3
        return position, 1, 3, 3, rotation, 3 * ((self.degree + 1) ** 2 - 1)


class Stream(Protocol):
    def read(self, size: int, /) -> bytes:
        """Up to `size` bytes; empty at the end."""
        ...


class Sections:
    """The sections in order, read block by block."""

    def __init__(self, path: Path, header: Header, streams: Iterator[Stream]) -> None:
        self._path, self._header, self._streams = path, header, streams

    def blocks(self, section: int) -> Iterator[tuple[slice, Bytes]]:
        """Blocks of the next section: the slice of Gaussians and their bytes (rows, width) uint8. Raises InputError if
        the section ends early."""
        count, width = self._header.count, self._header.widths[section]
        if count * width == 0:
            return
        stream = next(self._streams)
        for first in range(0, count, ROWS):
            rows = min(ROWS, count - first)
            data = _exactly(self._path, stream, rows * width)
            yield slice(first, first + rows), np.frombuffer(data, np.uint8).reshape(rows, width)

    def end(self) -> None:
        """Raises InputError if the data after the sections is damaged or too long."""
        for stream in self._streams:
            left = _MOST_AFTER
            while left > 0 and (part := stream.read(_CHUNK)):
                left -= len(part)
            if left <= 0:
                raise InputError(f"{self._path} continues after its last Gaussian; export it again.")
            if isinstance(stream, _Inflated) and not stream.is_complete:
                raise InputError(f"{self._path} is truncated; copy it again.")


def open_sections(path: Path, file: FileIO) -> tuple[Header, Sections]:
    """The header and the sections. Raises InputError if `file` is not an SPZ file, or has an unsupported version."""
    begin = file.read(_HEADER.size)
    file.seek(0)
    zipped = begin.startswith(b"\x1f\x8b")
    stream: Stream = _Inflated(path, file) if zipped else file
    header = _header(path, _exactly(path, stream, _HEADER.size))
    if header.version >= _STREAMED:
        if zipped:
            raise InputError(f"{path} is an SPZ file of version {header.version} compressed twice; unpack it.")
        return header, Sections(path, header, _streams(path, file, header))
    if not zipped and header.count * sum(header.widths) > size_of(file) - _HEADER.size:
        raise InputError(
            f"{path} is truncated: {header.count} Gaussians announced, but it is too small; copy it again."
        )
    # One entry per section, all of the same stream, and one more for the data after the sections.
    return header, Sections(path, header, iter([stream] * (sum(w * header.count > 0 for w in header.widths) + 1)))


def unpack(gaussians: Gaussians, header: Header, sections: Sections) -> None:
    """Decodes the sections into `gaussians`, in the axes of the file. Raises InputError if the file ends early."""
    g, f = gaussians, np.float32
    for rows, data in sections.blocks(0):
        g.means[rows] = _positions(header, data)
    for rows, data in sections.blocks(1):
        alpha = np.clip(data[:, 0] / f(255), _LEAST_ALPHA, 1 - _LEAST_ALPHA)
        g.opacity_logits[rows] = np.log(alpha / (1 - alpha))
    for rows, data in sections.blocks(2):
        g.sh[rows, 0] = (data / f(255) - f(0.5)) / _COLOR_SCALE
    for rows, data in sections.blocks(3):
        g.log_scales[rows] = data / f(16) - f(10)
    for rows, data in sections.blocks(4):
        g.quats[rows] = _smallest_three(data) if header.version >= 3 else _three(data)
    for rows, data in sections.blocks(5):
        g.sh[rows, 1:] = ((data.astype(f) - 128) / 128).reshape(len(data), -1, 3)
    sections.end()


def _header(path: Path, data: bytes) -> Header:
    magic, version, count, degree, bits, flags, _ = _HEADER.unpack(data)
    if magic != MAGIC:
        raise InputError(f"{path} does not begin like an SPZ file; choose another file.")
    if version not in (1, 2, 3, 4) or degree > 3:
        raise InputError(
            f"{path} is an SPZ file of version {version} with harmonics of degree {degree}; NVSim can read versions"
            " 1 to 4 and degrees 0 to 3."
        )
    if bits > _MOST_BITS or (bits == 0 and version > 1):
        raise InputError(
            f"{path} has positions of {bits} fractional bits, but 1 to {_MOST_BITS} are possible; export it again."
        )
    return Header(version, count, degree, bits, flags)


def _streams(path: Path, file: FileIO, header: Header) -> Iterator[Stream]:
    """The streams of version 4, one after the other."""
    import zstandard

    file.seek(0)
    begin = _exactly(path, file, _LONG_HEADER)
    size = size_of(file)
    sizes = [width * header.count for width in header.widths if width * header.count]
    start = int.from_bytes(begin[16:20], "little")
    at = start + 16 * begin[15]
    if not _LONG_HEADER <= start <= at <= size or begin[15] != len(sizes):
        raise InputError(f"{path} is truncated or damaged: its table of streams is invalid; copy it again.")
    file.seek(start)
    table = struct.iter_unpack("<QQ", _exactly(path, file, 16 * begin[15]))
    for expected, (packed, unpacked) in zip(sizes, table, strict=True):
        if unpacked != expected or packed > size - at:
            raise InputError(
                f"{path} is truncated or damaged: its streams do not have the announced sizes; copy it again."
            )
        file.seek(at)
        source = io.BytesIO(_exactly(path, file, packed))
        at += packed
        yield zstandard.ZstdDecompressor().stream_reader(source, read_size=_CHUNK)


class _Inflated:
    """The decompressed content of a gzipped file as a stream."""

    def __init__(self, path: Path, file: FileIO) -> None:
        self._path, self._file, self._unpacker = path, file, zlib.decompressobj(31)

    def read(self, size: int, /) -> bytes:
        while not self._unpacker.eof:
            more = self._unpacker.unconsumed_tail or self._file.read(_CHUNK)
            data = self._unpacker.decompress(more, size)
            if data or (not more and not self._unpacker.eof):
                return data
        return b""

    @property
    def is_complete(self) -> bool:
        return self._unpacker.eof


def _exactly(path: Path, stream: Stream, size: int) -> bytes:
    parts: list[bytes] = []
    left = size
    while left:
        part = stream.read(left)
        if not part:
            raise InputError(f"{path} is truncated: {left} bytes are missing; copy it again.")
        parts.append(part)
        left -= len(part)
    return b"".join(parts)


def _positions(header: Header, data: Bytes) -> NDArray[np.float32]:
    if header.version == 1:
        return data.reshape(-1).view("<f2").astype(np.float32).reshape(-1, 3)
    parts = data.reshape(-1, 3, 3).astype(np.int32)
    whole = parts[..., 0] | parts[..., 1] << 8 | parts[..., 2] << 16
    whole -= (whole >= 1 << 23).astype(np.int32) << 24
    return whole.astype(np.float32) * np.float32(1 / (1 << header.bits))


def _three(data: Bytes) -> NDArray[np.float32]:
    """(N, 4) w x y z from x, y and z as bytes."""
    xyz = data / np.float32(127.5) - np.float32(1)
    w = np.sqrt(np.maximum(1 - (xyz**2).sum(axis=1, dtype=np.float32), 0))
    return np.column_stack([w, xyz]).astype(np.float32)


def _smallest_three(data: Bytes) -> NDArray[np.float32]:
    """(N, 4) w x y z from three components of 9 bits and a sign. Two bits name the omitted, largest component in the
    order x y z w."""
    packed = data.reshape(-1).view("<u4").astype(np.uint32)
    left_out = (packed >> 30).astype(np.intp)
    quats = np.zeros((len(packed), 4), np.float32)
    for axis in (3, 2, 1, 0):
        held = left_out != axis
        size = (packed & 511).astype(np.float32) / np.float32(511) * np.float32(0.5**0.5)
        quats[held, axis] = np.where(packed >> 9 & 1, -size, size)[held]
        packed = np.where(held, packed >> 10, packed)
    quats[np.arange(len(quats)), left_out] = np.sqrt(np.maximum(1 - (quats**2).sum(axis=1), 0))
    return quats[:, [3, 0, 1, 2]]
