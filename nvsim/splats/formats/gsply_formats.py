"""Read and write SuperSplat's compressed PLY and Niantic's SPZ, versions 1 to 4, with the gsply library.

In a compressed PLY, position, rotation, scale, and color of a Gaussian are quantized to 16 bytes in chunks of 256
Gaussians, SH coefficients to a byte each (PlayCanvas splat-transform, compressed-ply).

SPZ uses x right, y up, z back; splat PLYs use x right, y down, z forward. The conversion changes the sign of y and z,
and of the harmonics that are odd in them.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.opening import opened, size_of
from nvsim.files.reading import reading
from nvsim.splats import harmonics
from nvsim.splats.formats.cleaning import room_for
from nvsim.splats.formats.spz_sections import ANTIALIASED, open_sections, unpack
from nvsim.splats.types import Gaussians

if TYPE_CHECKING:
    from gsply import GSData

T = TypeVar("T")


def call_safely(path: Path, call: Callable[[], T]) -> T:
    """Returns the result of `call`. Raises InputError if the library fails because the file is damaged."""
    try:
        return call()
    except (ValueError, KeyError, IndexError, OverflowError, EOFError, OSError, RuntimeError, ArithmeticError) as error:
        raise InputError(f"{path} is damaged ({error}); export it again.") from error
    except Exception as error:
        if type(error).__module__.partition(".")[0] in ("zlib", "struct", "zstandard", "gsply"):
            raise InputError(f"{path} is damaged ({error}); export it again.") from error
        raise


def from_library(data: GSData) -> Gaussians:
    """Our Gaussians. Values that are not finite are kept."""
    n = len(data.means)
    higher = np.zeros((n, 0, 3), np.float32) if data.shN is None else np.asarray(data.shN, np.float32)
    sh = np.concatenate([np.asarray(data.sh0, np.float32).reshape(n, 1, 3), higher.reshape(n, -1, 3)], axis=1)
    return Gaussians(
        np.ascontiguousarray(data.means, np.float32),
        np.ascontiguousarray(data.scales, np.float32),
        np.ascontiguousarray(data.quats, np.float32),
        np.ascontiguousarray(data.opacities, np.float32).reshape(-1),
        np.ascontiguousarray(sh),
    )


def to_library(gaussians: Gaussians) -> GSData:
    """The Gaussians in the library's PLY convention: log scales, logit opacities, unit quaternions w x y z."""
    import gsply

    g = gaussians
    length = np.linalg.norm(g.quats, axis=1, keepdims=True)
    unit = np.where(length > 0, g.quats / np.maximum(length, 1e-20), np.array([1, 0, 0, 0], np.float32))
    # Byte formats store opacities of 1/255 and more. Logits beyond this range would only overflow.
    return gsply.GSData(
        g.means.copy(),
        np.clip(g.log_scales, -20, 20),
        unit.astype(np.float32),
        np.clip(g.opacity_logits, -20, 20),
        np.ascontiguousarray(g.sh[:, 0]),
        np.ascontiguousarray(g.sh[:, 1:]),
    )


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
    return from_library(call_safely(path, lambda: gsply.plyread(path)))


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


_FLIP = np.array([1, -1, -1], np.float32)


def read_spz(path: Path) -> tuple[Gaussians, bool]:
    """The Gaussians in the axes of a PLY, and whether to render them with antialiasing. Reading needs memory for the
    result and one block, and for version 4 also one compressed stream. Raises InputError naming the file if it is
    truncated or damaged, or if its version or degree is not supported."""
    with opened(path) as file, reading(path, "an SPZ file", "copy it again"):
        head, sections = open_sections(path, file)
        gaussians = room_for(path, head.count, (head.degree + 1) ** 2, size_of(file))
        unpack(gaussians, head, sections)
    gaussians.means[:, 1:] *= -1
    gaussians.quats[:, 2:] *= -1
    gaussians.sh *= _harmonic_signs(gaussians.sh.shape[1])[None, :, None]
    return gaussians, bool(head.flags & ANTIALIASED)


def write_spz(path: Path, gaussians: Gaussians, antialiased: bool) -> None:
    """Writes version 3, which every reader supports, atomically. The resolution of positions depends on their extent
    and is at best 1/4096 m. Raises InputError if a Gaussian is too far from the origin, or if the disk refuses."""
    import gsply

    reach = float(np.abs(gaussians.means).max()) if len(gaussians) else 0.0
    bits = min(12, 22 - int(np.ceil(np.log2(max(reach, 1e-3)))))
    if bits < 1:
        raise InputError(f"{path} cannot be written: a Gaussian is {reach:.3g} m from the origin, too far for SPZ.")
    library = to_library(flip_y_and_z(gaussians))
    with atomic.replacement_file(path) as temporary:
        gsply.write_spz(temporary, library, version=3, fractional_bits=bits)
        if antialiased:
            temporary.write_bytes(_set_antialiased_flag(temporary.read_bytes()))


def flip_y_and_z(gaussians: Gaussians) -> Gaussians:
    """The Gaussians rotated by 180 degrees about x: y and z change sign in means, rotations, and harmonics. Applying it
    twice gives the input."""
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
    # Every function is even or odd under this rotation, so one direction is enough to determine its sign.
    direction = np.array([0.36, 0.48, 0.8], np.float32)
    degree = round(count**0.5) - 1
    return np.sign(harmonics.basis(direction * _FLIP, degree) * harmonics.basis(direction, degree)).astype(np.float32)


def _set_antialiased_flag(data: bytes) -> bytes:
    raw = bytearray(zlib.decompress(data, 31))
    raw[14] |= ANTIALIASED
    packer = zlib.compressobj(6, zlib.DEFLATED, 31)
    return packer.compress(bytes(raw)) + packer.flush()
