"""How many Gaussians a compressed file may announce: what they take in memory stays in proportion to its size, so that
a small file cannot fill the machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.splats.types import Gaussians

FREE, RATIO = 32 << 20, 24
"""Bytes in memory that any file may take, and that each of its bytes may. SOG and SPZ of real scenes are at 4 to 20."""
ROWS = 1 << 14
"""Gaussians that are decoded at a time."""


def room_for(path: Path, count: int, coefficients: int, size: int) -> Gaussians:
    """Empty arrays for the `count` Gaussians that a compressed file of `size` bytes announces, with so many harmonics
    of each colour. Raises InputError when that is more than a file of its size can hold."""
    needed = 4 * (11 + 3 * coefficients) * count
    if needed > FREE + RATIO * size:
        raise InputError(
            f"{path} announces {count} Gaussians, more than a file of {size} bytes holds; it is damaged or made to fill"
            " the memory: export it again."
        )
    shapes = (count, 3), (count, 3), (count, 4), (count,), (count, coefficients, 3)
    return Gaussians(*(np.empty(shape, np.float32) for shape in shapes))
