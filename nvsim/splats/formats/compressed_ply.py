"""SuperSplat's compressed PLY: positions, rotations, scales and colours quantised to 16 bytes within chunks of 256
Gaussians, harmonics to a byte each (PlayCanvas splat-transform, compressed-ply)."""

from __future__ import annotations

from pathlib import Path

from nvsim import atomic
from nvsim.errors import InputError
from nvsim.splats.formats.library import from_library, guarded, to_library
from nvsim.splats.types import Gaussians

CHUNK = 256
_SIZES = {"float": 4, "uint": 4, "uchar": 1, "float32": 4, "uint32": 4, "uint8": 1}


def read_compressed_ply(path: Path) -> Gaussians:
    """Raises InputError naming the file when it is truncated or damaged."""
    import gsply

    _check(path, path.read_bytes())
    return from_library(path, guarded(path, lambda: gsply.plyread(path)))


def write_compressed_ply(path: Path, gaussians: Gaussians) -> None:
    """In another order than they came in: the format wants neighbours in one chunk. Whole or not at all; raises
    InputError when there are no Gaussians, or when the disk refuses."""
    import gsply

    if len(gaussians) == 0:
        raise InputError(f"{path} cannot be written: a compressed PLY needs at least one Gaussian.")
    data = gsply.compress_to_bytes(to_library(gaussians))
    atomic.write_bytes(path, bytes(data))


def _check(path: Path, data: bytes) -> None:
    # Counts against the size of the file, before anything is allocated for them.
    end = data.find(b"end_header")
    begin = data.find(b"\n", end) + 1
    if end < 0 or begin == 0:
        raise InputError(f"{path} has no end_header, so its header is truncated; copy it again.")
    needed, counts, count = 0, {}, 0
    for number, line in enumerate(data[:end].decode("ascii", "replace").splitlines(), 1):
        words = line.split()
        if words[:1] == ["element"] and len(words) == 3 and words[2].isdigit() and len(words[2]) < 12:
            count = int(words[2])
            counts[words[1]] = count
        elif words[:1] == ["property"]:
            if len(words) != 3 or words[1] not in _SIZES:
                raise InputError(f"{path}, line {number}: {line[:60]!r} is not of a compressed PLY; export it again.")
            needed += count * _SIZES[words[1]]
    splats = counts.get("vertex", 0)
    if needed > len(data) - begin:
        raise InputError(f"{path} is truncated: {splats} Gaussians announced, but the file ends early; copy it again.")
    if splats == 0 or counts.get("chunk", 0) != -(-splats // CHUNK) or counts.get("sh", splats) != splats:
        raise InputError(
            f"{path} announces {splats} Gaussians in {counts.get('chunk', 0)} chunks of {CHUNK}; export it again."
        )
