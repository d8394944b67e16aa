"""None, True and False stay alive, as they do from Python 3.12 on.

PySide6 6.12 hands out these three without counting the reference: every call of a Qt method that returns nothing
costs one reference to None, every `Signal.emit` one to True. On Python 3.11 a count reaches zero after some thousand
calls and the interpreter aborts ("none_dealloc: deallocating None"). PEP 683 made the three immortal in 3.12; a count
that nothing reaches is the same thing.
"""

from __future__ import annotations

import ctypes
import sys

_FAR_AWAY = 1 << 40


def protect() -> None:
    """Raises the reference counts of the three out of reach. Does nothing where they are immortal already."""
    if sys.implementation.name != "cpython" or sys.version_info >= (3, 12):
        return
    for value in (None, True, False):
        # The count is the first field of an object; in a build where it is not, leave everything alone.
        count = ctypes.c_ssize_t.from_address(id(value))
        if abs(count.value - sys.getrefcount(value)) < 1000 and count.value < _FAR_AWAY:
            count.value += _FAR_AWAY
