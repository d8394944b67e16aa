"""Renders small views in parallel, each with one thread: the kernels of one small view gain nothing from a second
core."""

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
    """The results of `draw` for each of `views` views, in order. It is called with the index and a workspace, in as
    many threads as the kernels can use, each with single-threaded kernels. The views are drawn one after the other if
    several threads cannot start kernels."""
    import numba

    threads = numba.get_num_threads()
    numbers, found = count(), dict[int, T]()

    def work() -> None:
        before = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            # A step of `count` is atomic in the interpreter, so no two threads get an equal number.
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
