"""Read and write Niantic's SPZ, versions 1 to 4, whose files have about a tenth of the size of a PLY.

SPZ uses x right, y up, z back; splat PLYs use x right, y down, z forward. The conversion changes the sign of y and z,
and of the harmonics that are odd in them."""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.reading import reading
from nvsim.files.regular import opened, size_of
from nvsim.splats import harmonics
from nvsim.splats.formats.bound import room_for
from nvsim.splats.formats.library import to_library
from nvsim.splats.formats.spz_sections import ANTIALIASED, open_sections, unpack
from nvsim.splats.types import Gaussians

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
    library = to_library(flipped(gaussians))
    with atomic.replacing(path) as temporary:
        gsply.write_spz(temporary, library, version=3, fractional_bits=bits)
        if antialiased:
            temporary.write_bytes(_flagged(temporary.read_bytes()))


def flipped(gaussians: Gaussians) -> Gaussians:
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


def _flagged(data: bytes) -> bytes:
    raw = bytearray(zlib.decompress(data, 31))
    raw[14] |= ANTIALIASED
    packer = zlib.compressobj(6, zlib.DEFLATED, 31)
    return packer.compress(bytes(raw)) + packer.flush()
