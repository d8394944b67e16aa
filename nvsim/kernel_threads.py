"""Which library runs the threads of the numba kernels: chosen here, before numba looks for one.

Left alone, numba takes Intel's TBB wherever some other program brought it along, and a process that used it does not
always end: TBB waits in its unloading (`unload_tbb`) for threads that are gone. So it comes last. OpenMP comes first,
because any number of Python threads may start kernels on it. Numba's own pool is part of every numba and stands in
where there is no OpenMP; it ends the process when two threads start kernels at once, which `LOCK` of
`nvsim.render.workspace` prevents and `at_once` tells. The kernels deal their work out to numbered parts themselves, so
results are the same on all of them.
"""

from __future__ import annotations

import os
import sys

PRIORITY = ("omp", "workqueue", "tbb")
_VARIABLE = "NUMBA_THREADING_LAYER_PRIORITY"
_LIMITS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def cores() -> int:
    """That this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def allowed() -> int:
    """Threads that this process may use at once: its cores, or fewer where the environment says so."""
    said = os.environ.get(_LIMITS[0], "")
    return min(int(said), cores()) if said.isdecimal() and int(said) else cores()


def limit(threads: int) -> dict[str, str]:
    """The environment of a process that computes with so many threads, at least 1 and at most as many as cores."""
    return dict.fromkeys(_LIMITS, str(min(max(threads, 1), cores())))


def choose() -> None:
    """Sets the order of numba's threading layers, for this process and those that it starts. A choice that the
    environment holds already stays, and so does a pool that already runs."""
    order = os.environ.setdefault(_VARIABLE, " ".join(PRIORITY)).split()
    numba = sys.modules.get("numba")
    if numba is not None:  # it read the environment when it was imported
        numba.config.THREADING_LAYER_PRIORITY = order


def at_once() -> bool:
    """Whether several Python threads may start kernels at once here; False until a first kernel ran."""
    import numba

    try:
        return str(numba.threading_layer()) in ("omp", "tbb")
    except ValueError:
        return False
