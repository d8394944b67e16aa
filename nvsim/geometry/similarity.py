"""The least-squares similarity (scale, rotation, translation) between two sets of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def fitted_similarity(
    source: NDArray[np.float64], target: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Scale, rotation (3, 3), and shift (3,) of the least-squares similarity from `source` (N, 3) to `target` (N, 3)
    (Umeyama 1991): scale * rotation @ source + shift."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, size, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt)) or 1.0])
    rotation = u * sign @ vt
    scale = float((size * sign).sum() / max((a**2).sum(), 1e-24))
    return scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0)
