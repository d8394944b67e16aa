"""Angle features of R2R agents."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def angle_feature(
    heading: NDArray[np.floating],  # (...) radians, relative to the agent's heading; right is positive
    elevation: NDArray[np.floating],  # (...) radians above the horizon
    size: int = 4,
) -> NDArray[np.float32]:
    """Returns (..., size) sin and cos of the heading, then sin and cos of the elevation, repeated up to `size`.

    Source: EnvDrop and VLN↻BERT, whose size is 128; HAMT and VLN-DUET, 4.
    """
    four = np.stack([np.sin(heading), np.cos(heading), np.sin(elevation), np.cos(elevation)], axis=-1)
    return np.tile(four.astype(np.float32), size // 4)
