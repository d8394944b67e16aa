"""The principal axes of a neighborhood of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def axes_of(around: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N, 3, 3) float64 unit axes, in columns, of N neighborhoods of points (N, K, 3).

    The points spread least along the first axis, which is the surface normal if they are on a surface. Signs are
    arbitrary."""
    centred = around.astype(np.float64)
    centred -= centred.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))[1])
