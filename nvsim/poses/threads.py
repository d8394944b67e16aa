"""The threads of the computation of poses."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

from threadpoolctl import threadpool_limits

from nvsim.kernel_threads import allowed_threads


@contextmanager
def thread_pool() -> Iterator[ThreadPoolExecutor]:
    """A pool with a thread for each core. An interruption cancels the work that has not started.

    Meanwhile a matrix product uses one thread: the threads of OpenBLAS wait actively, and would take three times the
    processor time of the products."""
    pool = ThreadPoolExecutor(allowed_threads(), "poses")
    try:
        with threadpool_limits(1, "blas"):
            yield pool
    finally:
        pool.shutdown(cancel_futures=True)
