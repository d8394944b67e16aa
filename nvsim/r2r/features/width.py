"""Fits a backbone's rows to the width of a layout."""

from __future__ import annotations

import numpy as np

from nvsim.r2r.features.backbone import Float32

SEED = 0


class Width:
    """Converts rows from `given` to `wanted` numbers.

    Narrow rows are padded with zeros. Wide rows are projected onto fixed orthogonal directions, which preserves
    distances on average.

    words  description of the conversion, stored in the features file
    """

    def __init__(self, given: int, wanted: int) -> None:
        self._zeros = max(0, wanted - given)
        self._onto: Float32 | None = None
        self.words = "the backbone's own"
        if wanted > given:
            self.words = f"{given} of the backbone, followed by {self._zeros} zeros"
        elif wanted < given:
            self.words = f"{given} of the backbone, projected onto {wanted} fixed orthogonal directions (seed {SEED})"
            self._onto = _orthogonal(given, wanted)

    def __call__(self, rows: Float32) -> Float32:
        """Returns (N, wanted) float32 for `rows` (N, given)."""
        if self._onto is not None:
            return np.asarray(rows @ self._onto, np.float32)
        return np.pad(rows, ((0, 0), (0, self._zeros))) if self._zeros else rows


def _orthogonal(given: int, wanted: int) -> Float32:
    """Returns (given, wanted) orthonormal columns times sqrt(given / wanted), which preserves lengths on average."""
    q, r = np.linalg.qr(np.random.default_rng(SEED).standard_normal((given, wanted)))
    return np.asarray(q * np.sign(np.diag(r)) * np.sqrt(given / wanted), np.float32)
