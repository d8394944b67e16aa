"""The desktop application: document, views, panels, and jobs. A thin layer over nvsim, which never imports it."""

from __future__ import annotations

import ctypes
import sys

_FAR_AWAY = 1 << 40


def _raise_singleton_refcounts() -> None:
    """Keeps None, True, and False alive on Python 3.11 and older: adds 2**40 to their reference counts.

    PySide6 6.12 returns these three objects without counting the reference. Every Qt method that returns nothing costs
    one reference to None, and every `Signal.emit` costs one to True. On Python 3.11 a count reaches zero after some
    thousand calls, and the interpreter aborts ("none_dealloc: deallocating None"). In Python 3.12, PEP 683 made the
    three objects immortal. A very large reference count has an equal effect."""
    if sys.implementation.name != "cpython" or sys.version_info >= (3, 12):
        return
    for value in (None, True, False):
        # The count is the first field of an object. If a build has another layout, leave the object unchanged.
        count = ctypes.c_ssize_t.from_address(id(value))
        if abs(count.value - sys.getrefcount(value)) < 1000 and count.value < _FAR_AWAY:
            count.value += _FAR_AWAY


_raise_singleton_refcounts()
