"""Niantic's SPZ, versions 1 to 4: about a tenth of a PLY. Its axes are x right, y up, z back, against x right, y down,
z forward of splat PLYs, so y and z and the harmonics that are odd in them change sign on the way."""

from __future__ import annotations

import gzip
import struct
import tempfile
import zlib
from pathlib import Path

import numpy as np

from nvsim import atomic
from nvsim.errors import InputError
from nvsim.splats import harmonics
from nvsim.splats.formats.library import from_library, guarded, to_library
from nvsim.splats.types import Gaussians

MAGIC = 0x5053474E
ANTIALIASED = 1
"""Its bit among the flags."""
_HEADER = struct.Struct("<IIIBBBB")
_FLIP = np.array([1, -1, -1], np.float32)
_BYTES_PER_SPLAT = 9 + 1 + 3 + 3 + 3
"""Position, alpha, colour, scale, and the smaller of the two rotations, without harmonics."""
_MOST_DEFLATED = 1040
"""Deflate cannot shrink anything further than this."""
_MOST_BITS = 24
_STREAMED = 4
"""The version from which on attributes are streams of their own."""


def read_spz(path: Path) -> tuple[Gaussians, bool]:
    """The Gaussians in the axes of a PLY, and whether they are to be drawn antialiased. Raises InputError naming the
    file when it is truncated or damaged, or of a version or degree that is not supported."""
    import gsply

    data = path.read_bytes()
    version, flags = _check(path, data)
    if data.startswith(b"NGSP") and version < _STREAMED:
        # The payload as it is before it is zipped; the library knows zipped ones.
        with tempfile.TemporaryDirectory() as folder:
            zipped = Path(folder) / path.name
            zipped.write_bytes(gzip.compress(data, 1))
            library = guarded(path, lambda: gsply.read_spz(zipped))
    else:
        library = guarded(path, lambda: gsply.read_spz(path))
    return flipped(from_library(path, library)), bool(flags & ANTIALIASED)


def write_spz(path: Path, gaussians: Gaussians, antialiased: bool) -> None:
    """Version 3, which every reader knows, with positions as fine as their extent allows, at best 1/4096 m. Whole or
    not at all; raises InputError when the Gaussians lie too far out for the format, or when the disk refuses."""
    import gsply

    reach = float(np.abs(gaussians.means).max()) if len(gaussians) else 0.0
    bits = min(12, 22 - int(np.ceil(np.log2(max(reach, 1e-3)))))
    if bits < 1:
        raise InputError(f"{path} cannot be written: a Gaussian lies {reach:.3g} m from the origin, too far for SPZ.")
    library = to_library(flipped(gaussians))
    with atomic.replacing(path) as temporary:
        gsply.write_spz(temporary, library, version=3, fractional_bits=bits)
        if antialiased:
            temporary.write_bytes(_flagged(temporary.read_bytes()))


def flipped(gaussians: Gaussians) -> Gaussians:
    """Turned by half a turn about x: y and z change sign, means, rotations and harmonics alike. Its own inverse."""
    g = gaussians
    signs = _harmonic_signs(g.sh.shape[1])
    quats = g.quats * np.array([1, 1, -1, -1], np.float32)
    return Gaussians(
        np.ascontiguousarray(g.means * _FLIP),
        g.log_scales,
        np.ascontiguousarray(quats),
        g.opacity_logits,
        np.ascontiguousarray(g.sh * signs[None, :, None]),
    )


def _harmonic_signs(count: int) -> np.ndarray:
    # Every function is even or odd under the turn, so its value at any one direction tells.
    direction = np.array([0.36, 0.48, 0.8], np.float32)
    degree = round(count**0.5) - 1
    return np.sign(harmonics.basis(direction * _FLIP, degree) * harmonics.basis(direction, degree)).astype(np.float32)


def _flagged(data: bytes) -> bytes:
    raw = bytearray(zlib.decompress(data, 31))
    raw[14] |= ANTIALIASED
    packer = zlib.compressobj(6, zlib.DEFLATED, 31)
    return packer.compress(bytes(raw)) + packer.flush()


def _check(path: Path, data: bytes) -> tuple[int, int]:
    # The announced count against the size of the file, before anything is allocated for it. Returns version and flags.
    zipped = data.startswith(b"\x1f\x8b")
    try:
        head = zlib.decompressobj(31).decompress(data, _HEADER.size) if zipped else data[: _HEADER.size]
        magic, version, count, degree, bits, flags, _ = _HEADER.unpack(head)
    except (zlib.error, struct.error) as error:
        raise InputError(f"{path} is truncated or damaged ({error}); copy it again.") from error
    if magic != MAGIC:
        raise InputError(f"{path} does not begin as an SPZ file does; choose another file.")
    if version not in (1, 2, 3, 4) or degree > 3 or bits > _MOST_BITS:
        raise InputError(
            f"{path} is an SPZ file of version {version} with harmonics of degree {degree}; versions 1 to 4 and"
            " degrees 0 to 3 can be read."
        )
    least = count * (_BYTES_PER_SPLAT + 3 * ((degree + 1) ** 2 - 1))
    if zipped and (least > _MOST_DEFLATED * len(data) or least > int.from_bytes(data[-4:], "little")):
        raise InputError(f"{path} is truncated: {count} Gaussians announced, but it is too small; copy it again.")
    if not zipped and version >= _STREAMED:
        _check_streams(path, data, least)
    elif not zipped and least > len(data) - _HEADER.size:
        raise InputError(f"{path} is truncated: {count} Gaussians announced, but it is too small; copy it again.")
    return int(version), int(flags)


def _check_streams(path: Path, data: bytes, least: int) -> None:
    # Version 4: a table of (compressed, raw) sizes of streams that lie one after the other.
    if len(data) < 32:
        raise InputError(f"{path} is truncated; copy it again.")
    streams, start = data[15], int.from_bytes(data[16:20], "little")
    end = start + 16 * streams
    if not 32 <= start <= end <= len(data):
        raise InputError(f"{path} is truncated: its table of streams is not there; copy it again.")
    sizes = np.frombuffer(data, "<u8", 2 * streams, start).reshape(-1, 2).astype(object)
    packed, raw = sum(sizes[:, 0]), sum(sizes[:, 1])
    if packed > len(data) - end or raw < least or raw > 2 * least + 64:
        raise InputError(f"{path} is truncated or damaged: its streams do not have the announced sizes; copy it again.")
