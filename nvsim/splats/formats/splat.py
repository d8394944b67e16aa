"""The .splat file of antimatter15: 32 bytes a Gaussian, no header, no harmonics."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.files.regular import read_bytes
from nvsim.splats.formats.library import finite
from nvsim.splats.harmonics import DC
from nvsim.splats.types import Gaussians

_ROW = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("colour", "u1", 4), ("rotation", "u1", 4)])
_LEAST_SCALE = 1e-7


def read_splat(path: Path) -> Gaussians:
    """Raises InputError naming the file when it is empty, truncated or holds values that cannot be."""
    data = read_bytes(path)
    if not data or len(data) % _ROW.itemsize:
        raise InputError(
            f"{path} has {len(data)} bytes, which is no whole number of Gaussians of {_ROW.itemsize}; copy it again."
        )
    rows = np.frombuffer(data, _ROW)
    if not (rows["scale"] >= 0).all():
        row = int(np.argmin((rows["scale"] >= 0).all(axis=1)))
        raise InputError(
            f"{path} holds scales that are negative or no numbers, the first in Gaussian {row}, so it is no .splat"
            " file; choose another."
        )
    opacity = np.clip(rows["colour"][:, 3] / 255, 0.5 / 255, 1 - 0.5 / 255)
    quats = (rows["rotation"].astype(np.float32) - 128) / 128
    return finite(
        path,
        Gaussians(
            np.ascontiguousarray(rows["mean"], np.float32),
            np.log(np.maximum(rows["scale"], _LEAST_SCALE)).astype(np.float32),
            np.where((quats == 0).all(axis=1, keepdims=True), np.array([1, 0, 0, 0], np.float32), quats),
            np.log(opacity / (1 - opacity)).astype(np.float32),
            ((rows["colour"][:, None, :3] / 255 - 0.5) / DC).astype(np.float32),
        ),
    )
