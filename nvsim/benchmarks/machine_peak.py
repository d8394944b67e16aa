"""Measures the peak rate of single-precision multiply-adds of this machine, with which kernels are compared."""

from __future__ import annotations

import time

import numba
import numpy as np
from numba import njit, prange

from nvsim.render.kernel_types import Float32

_F = np.float32
_STEPS, _LANES, _ROUNDS = 32, 2048, 4000


@njit(parallel=True, fastmath=True)
def _horner(
    threads: int,
    rounds: int,
    out: Float32,  # (threads, _LANES) changed
) -> None:
    # A polynomial of degree 32 in each lane, so that nearly all instructions are multiply-adds.
    for thread in prange(threads):
        values = out[thread]
        for r in range(rounds):
            shift = _F(r) * _F(1e-7)
            for i in range(_LANES):
                x = values[i] * _F(0.5) + shift
                p = x
                for _ in range(_STEPS):
                    p = p * x + _F(0.25)
                values[i] = p


def multiply_adds_per_second() -> float:
    """Multiply-adds per second of a vectorized loop with all threads of numba. Returns the best of five runs
    of about a quarter of a second each."""
    threads = numba.get_num_threads()
    values = np.full((threads, _LANES), 0.1, np.float32)
    _horner(threads, 1, values)
    best = 0.0
    for _ in range(5):
        started = time.perf_counter()
        _horner(threads, _ROUNDS, values)
        seconds = time.perf_counter() - started
        best = max(best, threads * _ROUNDS * _LANES * (_STEPS + 1) / seconds)
    return best
