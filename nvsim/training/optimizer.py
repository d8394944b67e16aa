"""Adam in one sweep over a group of parameters (Kingma and Ba 2015), with a learning rate per column."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

_F = np.float32
_ONE = _F(1)
BETA1, BETA2, EPS = 0.9, 0.999, 1e-15
CHUNK = 1 << 14
Float32 = NDArray[np.float32]


@njit(parallel=True, cache=True, fastmath=True)
def _adam(values: Any, gradient: Any, first: Any, second: Any, rates: Any, factors: Any) -> None:
    # values .. second are flat and run over rows of len(rates) columns; factors: beta1, beta2, eps, and the square
    # root of the second moment's bias correction. The first moment's is in the rates. CHUNK rows make a task.
    columns = rates.shape[0]
    rows = values.shape[0] // columns
    beta1, beta2, eps, correction = factors[0], factors[1], factors[2], factors[3]
    per_task = max(CHUNK // columns, 1)
    for task in prange((rows + per_task - 1) // per_task):
        begin, end = task * per_task * columns, min(rows, (task + 1) * per_task) * columns
        rate = np.empty(CHUNK + columns, np.float32)
        for i in range(per_task):
            for c in range(columns):
                rate[i * columns + c] = rates[c]
        v, g = values[begin:end], gradient[begin:end]
        m, s = first[begin:end], second[begin:end]
        for i in range(end - begin):
            slope = g[i]
            mean = beta1 * m[i] + (_ONE - beta1) * slope
            square = beta2 * s[i] + (_ONE - beta2) * slope * slope
            m[i], s[i] = mean, square
            v[i] -= rate[i] * mean / (np.sqrt(square) * correction + eps)


@dataclass(eq=False)
class Group:
    """Parameters (N, ...) float32 with their gradient and both moments; `rates` (columns,) per element of a row."""

    values: Float32
    gradient: Float32
    rates: Float32
    first: Float32
    second: Float32

    @staticmethod
    def of(values: Float32, rates: Float32 | float, gradient: Float32 | None = None) -> Group:
        """Fresh moments. `values` and `gradient` are kept, not copied."""
        columns = int(np.prod(values.shape[1:], dtype=int))
        spread = np.broadcast_to(np.asarray(rates, np.float32), (columns,)).copy()
        gradient = np.zeros_like(values) if gradient is None else gradient
        return Group(values, gradient, spread, np.zeros_like(values), np.zeros_like(values))

    def step(self, count: int, scale: float = 1.0) -> None:
        """The `count`-th update (from 1) with all rates times `scale`."""
        rates = self.rates * np.float32(scale / (1 - BETA1**count))
        factors = np.array([BETA1, BETA2, EPS, (1 - BETA2**count) ** -0.5], np.float32)
        values, gradient = self.values.reshape(-1), self.gradient.reshape(-1)
        _adam(values, gradient, self.first.reshape(-1), self.second.reshape(-1), rates, factors)
