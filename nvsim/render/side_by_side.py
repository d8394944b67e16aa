"""Small views at once, each with one thread: the kernels of one alone gain nothing from a second core."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import count
from typing import TypeVar

from nvsim.kernel_threads import at_once
from nvsim.render.workspace import LOCK, RenderBuffers

T = TypeVar("T")
_own = threading.local()


def side_by_side(draw: Callable[[int, RenderBuffers], T], views: int) -> list[T]:
    """What `draw` returns for each of so many views, in their order, from as many threads as kernels may use here; it
    is given a workspace of its thread's own, with kernels that use one thread. One after the other where the kernels
    may not be started at once."""
    import numba

    threads = numba.get_num_threads()
    numbers, found = count(), dict[int, T]()

    def work() -> None:
        before = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            # A step of `count` is one of the interpreter's, so that no two threads get the same number.
            while (i := next(numbers)) < views:
                found[i] = draw(i, _workspace())
        finally:
            numba.set_num_threads(before)

    with LOCK:
        others = min(threads, views) - 1 if at_once() else 0
        waiting = [_pool(threads).submit(work) for _ in range(others)]
        try:
            work()
        finally:
            for other in waiting:
                other.result()
    return [found[i] for i in range(views)]


def _workspace() -> RenderBuffers:
    if not hasattr(_own, "buffers"):
        _own.buffers = RenderBuffers()
    buffers: RenderBuffers = _own.buffers
    return buffers


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, "view")
