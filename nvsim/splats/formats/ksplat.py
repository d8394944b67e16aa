"""Read the .ksplat format of GaussianSplats3D (mkkellogg), versions 0.x: sections of splats in buckets, as floats or
16-bit numbers. Spherical harmonics above degree 0 are skipped, so colors do not depend on the direction of view."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.regular import read_bytes
from nvsim.splats.formats.cleaning import FLATTEST
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians

_HEADER, _SECTION = 4096, 1024  # bytes
_HARMONICS = {0: 0, 1: 9, 2: 24}
_MOST_SECTIONS = 1024
_CENTRES, _SCALES, _ROTATIONS, _COLOURS = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 14)


def read_ksplat(path: Path) -> Gaussians:
    """The Gaussians of degree 0. Raises InputError naming the file if it is damaged or of another version."""
    data = read_bytes(path)
    with reading(path, "a .ksplat file", "export it again"):
        if len(data) < _HEADER or data[0] != 0:
            raise InputError(f"{path} is not a .ksplat file of version 0; export it again.")
        head = np.frombuffer(data, "<u4", 5)
        most, level = int(head[1]), int(np.frombuffer(data, "<u2", 1, 20)[0])
        if most > _MOST_SECTIONS or level not in (0, 1, 2):
            raise InputError(f"{path} has {most} sections of compression {level}; export it again.")
        at, parts = _HEADER + most * _SECTION, []
        for k in range(most):
            found, at = _section(data, _HEADER + k * _SECTION, at, level)
            parts.append(found)
        rows = np.concatenate([part for part in parts if len(part)] or [np.zeros((0, 14), np.float32)])
        if not len(rows):
            raise InputError(f"{path} contains no Gaussians; export it again.")
        opacity = np.clip(rows[:, 13] / 255, 0.5 / 255, 1 - 0.5 / 255)
        return Gaussians(
            np.ascontiguousarray(rows[:, _CENTRES]),
            np.log(np.maximum(rows[:, _SCALES], FLATTEST)).astype(np.float32),
            np.ascontiguousarray(rows[:, _ROTATIONS]),
            np.log(opacity / (1 - opacity)).astype(np.float32),
            ((rows[:, None, 10:13] / 255 - 0.5) / DC).astype(np.float32),
        )


def _section(data: bytes, header: int, at: int, level: int) -> tuple[NDArray[np.float32], int]:
    """(N, 14) the splats of the section with its header at `header` and its data at `at`, both in bytes: center, scale,
    rotation w x y z, color RGBA; and the end of its data. Raises ValueError if the file is shorter."""
    count, most, size, buckets = map(int, np.frombuffer(data, "<u4", 4, header))
    block = float(np.frombuffer(data, "<f4", 1, header + 16)[0])
    stored = int(np.frombuffer(data, "<u2", 1, header + 20)[0])
    reach = int(np.frombuffer(data, "<u4", 1, header + 24)[0]) or 32767
    full, partial = map(int, np.frombuffer(data, "<u4", 2, header + 32))
    degree = int(np.frombuffer(data, "<u2", 1, header + 40)[0])
    number, colour = ("<f4", "u1") if level == 0 else ("<u2", "u1")
    rest = ("<f4", "<u2", "u1")[level], _HARMONICS[degree]
    kind = np.dtype(
        [
            ("centre", number, 3),
            ("scale", "<f4" if level == 0 else "<f2", 3),
            ("rotation", "<f4" if level == 0 else "<f2", 4),
            ("colour", colour, 4),
            ("rest", rest[0], rest[1]),
        ]
    )
    lengths = np.frombuffer(data, "<u4", partial, at)
    middles = np.frombuffer(data, "u1", buckets * stored, at + 4 * partial).reshape(buckets, stored)
    begin = at + 4 * partial + buckets * stored
    rows = np.frombuffer(data, kind, count, begin)
    found = np.empty((count, 14), np.float32)
    found[:, _CENTRES] = rows["centre"]
    if level > 0:
        owners = np.concatenate([np.repeat(np.arange(full), size), full + np.repeat(np.arange(partial), lengths)])
        centres = np.ascontiguousarray(middles[:, :12]).view("<f4")
        found[:, _CENTRES] = (found[:, _CENTRES] - reach) * (0.5 * block / reach) + centres[owners[:count]]
    for name, columns in (("scale", _SCALES), ("rotation", _ROTATIONS), ("colour", _COLOURS)):
        found[:, columns] = rows[name]
    return found, begin + most * kind.itemsize
