"""Read the .splat format of antimatter15: 32 bytes per Gaussian, without a header or spherical harmonics."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.regular import read_bytes
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
