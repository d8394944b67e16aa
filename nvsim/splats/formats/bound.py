"""Limit the number of Gaussians that a compressed file may announce. The limit is proportional to the file size, so a
small file cannot exhaust the memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nvsim.errors import InputError
from nvsim.splats.types import Gaussians

FREE, RATIO = 32 << 20, 24
"""Bytes in memory allowed for any file, and additional bytes per byte of the file. Real SOG and SPZ files need 4 to 20
per byte."""
ROWS = 1 << 14
"""Number of Gaussians decoded at a time."""


def room_for(path: Path, count: int, coefficients: int, size: int) -> Gaussians:
    """Uninitialized arrays for the `count` Gaussians that a compressed file of `size` bytes announces, with so many SH
    coefficients per color channel. Raises InputError if a file of this size cannot contain so many Gaussians."""
    needed = 4 * (11 + 3 * coefficients) * count
    if needed > FREE + RATIO * size:
        raise InputError(
            f"{path} announces {count} Gaussians, more than a file of {size} bytes can contain; it is damaged or"
            " malicious: export it again."
        )
    shapes = (count, 3), (count, 3), (count, 4), (count,), (count, coefficients, 3)
    return Gaussians(*(np.empty(shape, np.float32) for shape in shapes))
