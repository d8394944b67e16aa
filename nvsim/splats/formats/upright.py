"""Find the up axis of a splat file, and rotate its Gaussians upright."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, get_args

import numpy as np

from nvsim.files.reading import reading
from nvsim.files.regular import opened
from nvsim.geometry.rotation import smallest_rotation
from nvsim.splats.turning import turned
from nvsim.splats.types import Gaussians

Up = Literal["z", "-z", "y", "-y", "x", "-x"]
UPS: tuple[Up, ...] = get_args(Up)


def up_of(path: Path) -> Up:
    """The up axis: z if a PLY header says so, else -y, because splat files use camera axes with y down. Raises
    InputError if the file cannot be read."""
    with opened(path) as file, reading(path, "a splat file"):
        header = file.read(4096)
    return "z" if header.startswith(b"ply") and b"Vertical Axis: z" in header else "-y"


def upright(gaussians: Gaussians, up: Up) -> Gaussians:
    """The Gaussians rotated so that `up` becomes z."""
    if up == "z":
        return gaussians
    axis = np.zeros(3)
    axis["xyz".index(up[-1])] = -1.0 if up.startswith("-") else 1.0
    if up == "-z":
        return turned(gaussians, np.diag([1.0, -1.0, -1.0]))
    return turned(gaussians, smallest_rotation(axis, np.array([0.0, 0.0, 1.0])))
