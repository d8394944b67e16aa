"""Angles as agents of R2R have them in their features."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def angle_feature(
    heading: NDArray[np.floating],  # (...) radians, relative to where the agent looks; right is positive
    elevation: NDArray[np.floating],  # (...) radians above the horizon
    size: int = 4,
) -> NDArray[np.float32]:
    """(..., size) sin and cos of the heading, sin and cos of the elevation, over and over.

    Source: EnvDrop and VLN↻BERT, whose size is 128; HAMT and VLN-DUET, 4.
    """
    four = np.stack([np.sin(heading), np.cos(heading), np.sin(elevation), np.cos(elevation)], axis=-1)
    return np.tile(four.astype(np.float32), size // 4)
