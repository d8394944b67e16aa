"""Choose the library that runs the threads of the numba kernels, before numba chooses one.

By default, numba uses Intel's TBB if it is installed. A process that used TBB may hang at its end: TBB's unloading
(`unload_tbb`) waits for threads that no longer exist. TBB is therefore the last choice. OpenMP is the first choice,
because any number of Python threads may start kernels on it. Numba's own pool (`workqueue`) is always available. It
ends the process if two threads start kernels at once, so `LOCK` in `nvsim.render.workspace` prevents that and
`can_start_kernels_at_once` tells whether it is allowed. The kernels split their work into numbered parts, so all three
libraries give equal results.
"""

from __future__ import annotations

import os
import sys

PRIORITY = ("omp", "workqueue", "tbb")
_VARIABLE = "NUMBA_THREADING_LAYER_PRIORITY"
_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def cores() -> int:
    """Number of processor cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def allowed_threads() -> int:
    """Number of threads that this process may use: its cores, or fewer if NUMBA_NUM_THREADS says so."""
    said = os.environ.get(_LIMITS[0], "")
    return min(int(said), cores()) if said.isdecimal() and int(said) else cores()


def limit(threads: int) -> dict[str, str]:
    """Environment variables that limit a process to so many threads, at least 1 and at most the number of cores."""
    return dict.fromkeys(_LIMITS, str(min(max(threads, 1), cores())))


def choose() -> None:
    """Sets the order of numba's threading layers for this process and its child processes. An order that the
    environment defines takes precedence. A pool that is already running stays."""
    order = os.environ.setdefault(_VARIABLE, " ".join(PRIORITY)).split()
    numba = sys.modules.get("numba")
    if numba is not None:  # numba reads the environment only when it is imported
        numba.config.THREADING_LAYER_PRIORITY = order


def can_start_kernels_at_once() -> bool:
    """Whether several Python threads may start kernels at once. False until the first kernel ran."""
    import numba

    try:
        return str(numba.threading_layer()) in ("omp", "tbb")
    except ValueError:
        return False
