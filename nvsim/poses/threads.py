"""The threads of the computation of poses."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

from nvsim.kernel_threads import allowed_threads


def one_thread_of_blas() -> threadpool_limits:
    """A context in which a product of matrices or vectors uses one thread. The threads of OpenBLAS wait actively, and
    take several times the processor time of the product."""
    return threadpool_limits(1, "blas")


@contextmanager
def thread_pool() -> Iterator[ThreadPoolExecutor]:
    """A pool with a thread for each core, and one thread of BLAS. An interruption cancels the work that has not
    started."""
    pool = ThreadPoolExecutor(allowed_threads(), "poses")
    try:
        with one_thread_of_blas():
            yield pool
    finally:
        pool.shutdown(cancel_futures=True)
