"""Run several functions in parallel that mostly wait for an endpoint."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")
_GRACE = 5.0  # seconds that running requests have to finish when the caller stops


def each(work: Callable[[T], R], items: Sequence[T], at_once: int) -> Iterator[tuple[T, R]]:
    """Yields every item with the result of `work` on it, in the order of completion. If `work` raises an error, no
    other item is started, running ones finish, and the error is raised. If the caller stops, running ones have a few
    seconds to finish."""
    waiting: queue.SimpleQueue[T] = queue.SimpleQueue()
    done: queue.SimpleQueue[tuple[T, R] | BaseException | None] = queue.SimpleQueue()
    stopped = threading.Event()
    for item in items:
        waiting.put(item)

    def worker() -> None:
        while not stopped.is_set():
            try:
                item = waiting.get_nowait()
            except queue.Empty:
                break
            try:
                done.put((item, work(item)))
            except BaseException as error:
                stopped.set()
                done.put(error)
        done.put(None)

    threads = [threading.Thread(target=worker, daemon=True) for _ in range(min(at_once, len(items)))]
    for thread in threads:
        thread.start()
    failed: BaseException | None = None
    left = len(threads)
    try:
        while left:
            found = done.get()
            if found is None:
                left -= 1
            elif isinstance(found, BaseException):
                failed = failed or found
            else:
                yield found
    finally:
        stopped.set()
        until = time.monotonic() + _GRACE
        for thread in threads:
            thread.join(max(0.0, until - time.monotonic()))
    if failed is not None:
        raise failed
