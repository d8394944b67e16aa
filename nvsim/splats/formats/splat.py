"""The .splat file of antimatter15: 32 bytes a Gaussian, no header, no harmonics."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.regular import read_bytes
from nvsim.splats.formats.cleaning import FLATTEST
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians

_ROW = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])
_FARTHEST = 1e6  # of coordinates and scales: beyond it the bytes are no .splat file


def read_splat(path: Path) -> Gaussians:
    """The Gaussians of the file; rows with NaN are kept. The format has no header, so the numbers have to prove it.

    Raises InputError naming the file when it is empty or truncated, when a coordinate or a scale is infinite,
    negative or beyond 1e6, or when most rows hold NaN.
    """
    data = read_bytes(path)
    if not data or len(data) % _ROW.itemsize:
        raise InputError(
            f"{path} has {len(data)} bytes, which is no whole number of Gaussians of {_ROW.itemsize}; copy it again."
        )
    rows = np.frombuffer(data, _ROW)
    with np.errstate(invalid="ignore"):  # a NaN passes here
        absurd = (np.abs(rows["mean"]) > _FARTHEST) | (rows["scale"] < 0) | (rows["scale"] > _FARTHEST)
    absurd = absurd.any(axis=1)
    missing = np.isnan(rows["mean"]).any(axis=1) | np.isnan(rows["scale"]).any(axis=1)
    if absurd.any() or missing.mean() > 0.5:
        row = int(np.argmax(absurd if absurd.any() else missing))
        raise InputError(
            f"{path} holds coordinates or scales that cannot be (NaN, negative or beyond {_FARTHEST:.0e}), the first in"
            f" Gaussian {row}, so it is no .splat file; download or export it again."
        )
    opacity = np.clip(rows["colour"][:, 3] / 255, 0.5 / 255, 1 - 0.5 / 255)
    return Gaussians(
        np.ascontiguousarray(rows["mean"], np.float32),
        np.log(np.maximum(rows["scale"], FLATTEST)).astype(np.float32),
        ((rows["rotation"].astype(np.float32) - 128) / 128).astype(np.float32),
        np.log(opacity / (1 - opacity)).astype(np.float32),
        ((rows["colour"][:, None, :3] / 255 - 0.5) / DC).astype(np.float32),
    )
