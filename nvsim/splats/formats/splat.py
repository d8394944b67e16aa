"""Read the .splat format of antimatter15, and the .ksplat format of GaussianSplats3D (mkkellogg), versions 0.x.

Spherical harmonics above degree 0 are skipped, so colors do not depend on the direction of view.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.files.opening import read_bytes
from nvsim.files.reading import reading
from nvsim.splats.formats.cleaning import FLATTEST
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians

_ROW = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])
_FARTHEST = 1e6  # largest coordinate and scale; a file with larger ones is not a .splat file


def read_splat(path: Path) -> Gaussians:
    """Reads the Gaussians. Rows with NaN are kept. The format has no header, so the file is recognized by its values.

    Raises InputError naming the file if it is empty or truncated. Raises InputError if a coordinate or scale is
    infinite or exceeds 1e6, if a scale is negative, or if most rows have NaN.
    """
    data = read_bytes(path)
    if not data or len(data) % _ROW.itemsize:
        raise InputError(
            f"{path} has {len(data)} bytes, which is not a multiple of {_ROW.itemsize} (one Gaussian); copy it again."
        )
    rows = np.frombuffer(data, _ROW)
    with np.errstate(invalid="ignore"):  # comparisons with NaN are false, so NaN is tested below
        absurd = (np.abs(rows["mean"]) > _FARTHEST) | (rows["scale"] < 0) | (rows["scale"] > _FARTHEST)
    absurd = absurd.any(axis=1)
    missing = np.isnan(rows["mean"]).any(axis=1) | np.isnan(rows["scale"]).any(axis=1)
    if absurd.any() or missing.mean() > 0.5:
        row = int(np.argmax(absurd if absurd.any() else missing))
        raise InputError(
            f"{path} contains invalid coordinates or scales (NaN, negative or beyond {_FARTHEST:.0e}), the first in"
            f" Gaussian {row}, so it is not a .splat file; download or export it again."
        )
    opacity = np.clip(rows["colour"][:, 3] / 255, 0.5 / 255, 1 - 0.5 / 255)
    return Gaussians(
        np.ascontiguousarray(rows["mean"], np.float32),
        np.log(np.maximum(rows["scale"], FLATTEST)).astype(np.float32),
        ((rows["rotation"].astype(np.float32) - 128) / 128).astype(np.float32),
        np.log(opacity / (1 - opacity)).astype(np.float32),
        ((rows["colour"][:, None, :3] / 255 - 0.5) / DC).astype(np.float32),
    )


_HEADER, _SECTION = 4096, 1024  # bytes
_HARMONICS = {0: 0, 1: 9, 2: 24}
_MOST_SECTIONS = 1024
_CENTERS, _SCALES, _ROTATIONS, _COLORS = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 14)


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
            np.ascontiguousarray(rows[:, _CENTERS]),
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
    number, color = ("<f4", "u1") if level == 0 else ("<u2", "u1")
    rest = ("<f4", "<u2", "u1")[level], _HARMONICS[degree]
    kind = np.dtype(
        [
            ("centre", number, 3),
            ("scale", "<f4" if level == 0 else "<f2", 3),
            ("rotation", "<f4" if level == 0 else "<f2", 4),
            ("colour", color, 4),
            ("rest", rest[0], rest[1]),
        ]
    )
    lengths = np.frombuffer(data, "<u4", partial, at)
    middles = np.frombuffer(data, "u1", buckets * stored, at + 4 * partial).reshape(buckets, stored)
    begin = at + 4 * partial + buckets * stored
    rows = np.frombuffer(data, kind, count, begin)
    found = np.empty((count, 14), np.float32)
    found[:, _CENTERS] = rows["centre"]
    if level > 0:
        owners = np.concatenate([np.repeat(np.arange(full), size), full + np.repeat(np.arange(partial), lengths)])
        centers = np.ascontiguousarray(middles[:, :12]).view("<f4")
        found[:, _CENTERS] = (found[:, _CENTERS] - reach) * (0.5 * block / reach) + centers[owners[:count]]
    for name, columns in (("scale", _SCALES), ("rotation", _ROTATIONS), ("colour", _COLORS)):
        found[:, columns] = rows[name]
    return found, begin + most * kind.itemsize
