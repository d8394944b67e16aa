"""The shape of a neighbourhood of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def axes_of(around: NDArray[np.floating]) -> NDArray[np.float64]:
    """(N, 3, 3) unit axes, in columns, of N neighbourhoods of points (N, K, 3): along the first, the normal where they
    lie on a surface, they spread least. Its sign is free."""
    centred = around.astype(np.float64)
    centred -= centred.mean(axis=1, keepdims=True)
    return np.asarray(np.linalg.eigh(np.einsum("nki,nkj->nij", centred, centred))[1])
