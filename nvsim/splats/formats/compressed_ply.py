"""Read and write SuperSplat's compressed PLY. Position, rotation, scale, and color of a Gaussian are quantized to 16
bytes in chunks of 256 Gaussians, SH coefficients to a byte each (PlayCanvas splat-transform, compressed-ply)."""

from __future__ import annotations

from pathlib import Path

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.reading import reading
from nvsim.files.regular import opened, size_of
from nvsim.splats.formats.library import from_library, guarded, to_library
from nvsim.splats.types import Gaussians

CHUNK = 256
_BOUNDS = tuple(
    f"{end}_{name}"
    for names in ("x y z", "scale_x scale_y scale_z", "r g b")
    for end in ("min", "max")
    for name in names.split()
)
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_SIZES = {"float": 4, "uint": 4, "uchar": 1, "float32": 4, "uint32": 4, "uint8": 1}
_HARMONICS = (9, 24, 45)
_LONGEST_HEADER = 1 << 16


def read_compressed_ply(path: Path) -> Gaussians:
    """Reads the Gaussians. Raises InputError naming the file if it is truncated or damaged."""
    import gsply

    with opened(path) as file, reading(path, "a compressed PLY"):
        _check(path, file.read(_LONGEST_HEADER), size_of(file))
    return from_library(guarded(path, lambda: gsply.plyread(path)))


def write_compressed_ply(path: Path, gaussians: Gaussians) -> None:
    """Writes the Gaussians atomically. Their order changes, because the format stores neighbors in one chunk. Raises
    InputError if there are no Gaussians, or if the disk refuses."""
    import gsply

    if len(gaussians) == 0:
        raise InputError(f"{path} cannot be written: a compressed PLY needs at least one Gaussian.")
    data = gsply.compress_to_bytes(to_library(gaussians))
    atomic.write_bytes(path, bytes(data))


def _check(path: Path, head: bytes, size: int) -> None:
    """Checks layout and counts against the `size` of the file before memory is allocated. Raises InputError."""
    end = head.find(b"end_header\n")
    if end < 0:
        raise InputError(f"{path} has no end_header, so its header is truncated; copy it again.")
    elements: dict[str, tuple[int, list[tuple[int, str]]]] = {}
    for number, line in enumerate(head[:end].decode("ascii", "replace").split("\n"), 1):
        match line.split():
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 12:
                elements[name] = int(count), []
            case ["property", kind, name] if kind in _SIZES and elements:
                elements[next(reversed(elements))][1].append((_SIZES[kind], name))
            case ["ply"] | ["format", "binary_little_endian", _] | ["comment", *_] | []:
                pass
            case _:
                raise InputError(
                    f"{path}, line {number}: {line[:60]!r} is not part of a compressed PLY; export it again."
                )
    splats, packed = elements.get("vertex", (0, []))
    chunks, bounds = elements.get("chunk", (0, []))
    _, harmonics = elements.get("sh", (0, []))
    if [*elements][:2] != ["chunk", "vertex"] or [*elements][2:] not in ([], ["sh"]):
        raise InputError(
            f"{path} has the elements {', '.join(elements)[:60]}; a compressed PLY has chunk, vertex and sh."
        )
    if bounds != [(4, name) for name in _BOUNDS] or packed != [(4, name) for name in _PACKED]:
        raise InputError(f"{path} has chunks of {len(bounds)} values and vertices of {len(packed)}; export it again.")
    if "sh" in elements and (len(harmonics) not in _HARMONICS or {w for w, _ in harmonics} != {1}):
        raise InputError(
            f"{path} has {len(harmonics)} SH coefficients for each Gaussian, but degrees 1 to 3 have 9, 24 or 45 of one"
            " byte each; export it again."
        )
    if splats == 0 or chunks != -(-splats // CHUNK) or elements.get("sh", (splats, []))[0] != splats:
        raise InputError(f"{path} announces {splats} Gaussians in {chunks} chunks of {CHUNK}; export it again.")
    needed = end + len(b"end_header\n") + sum(n * sum(w for w, _ in kinds) for n, kinds in elements.values())
    if needed > size:
        raise InputError(f"{path} is truncated: {splats} Gaussians announced, but the file ends early; copy it again.")
