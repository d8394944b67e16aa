"""Measure the limits of this machine: bytes moved and multiply-adds, in kernels like those of renderer and trainer.

python tests/benchmarks/machine_limits.py [--json]

The share of these limits that a kernel reaches shows how much can still be gained.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import tyro
from harness import best, report
from numba import njit, prange

from nvsim.benchmarks.render import multiply_adds_per_second

REPEATS = 15


@dataclass(frozen=True)
class Arguments:
    json: bool = False


@njit(parallel=True, fastmath=True)
def triad(a: Any, b: Any, c: Any) -> None:
    for i in prange(a.shape[0]):
        a[i] = b[i] + np.float32(0.5) * c[i]


def measure() -> dict[str, float]:
    figures = {"giga_multiply_adds": multiply_adds_per_second() / 1e9}
    for name, size in (("large", 32 << 20), ("cached", 1 << 19)):
        a, b, c = np.zeros((3, size), np.float32)
        seconds = best(lambda a=a, b=b, c=c: triad(a, b, c), REPEATS)  # type: ignore[misc]
        figures[f"gigabytes_{name}"] = 12 * size / seconds / 1e9
    return {**{k: round(v, 1) for k, v in figures.items()}, "threads": numba.get_num_threads()}


if __name__ == "__main__":
    arguments = tyro.cli(Arguments, description=__doc__)
    report(measure(), arguments.json)
