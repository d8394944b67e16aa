"""A file for h5py that keeps the first failed write to itself until it is asked.

When a write fails under it, the HDF5 library prints a traceback for each object that it lets go of, and may end the
process with a segmentation fault. It is told that all is well, and the file is thrown away.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class QuietFile(io.RawIOBase):
    """Reads and writes the file of a descriptor."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._at = descriptor, 0
        self._error: OSError | None = None

    def check(self) -> None:
        """Raises OSError where a write has failed."""
        if self._error is not None:
            raise self._error

    def readable(self) -> bool:
        return True

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: os.fstat(self._descriptor).st_size}[whence]
        self._at = start + offset
        return self._at

    def readinto(self, buffer: Any) -> int:
        count = os.preadv(self._descriptor, [buffer], self._at)
        self._at += count
        return count

    def write(self, data: Any) -> int:
        view = memoryview(data).cast("B")
        try:
            written = 0
            while self._error is None and written < len(view):
                written += os.pwrite(self._descriptor, view[written:], self._at + written)
        except OSError as error:
            self._error = error
        self._at += len(view)
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        size = self._at if size is None else size
        try:
            os.ftruncate(self._descriptor, size)
        except OSError as error:
            self._error = self._error or error
        return size


@contextmanager
def quietly_written(path: Path) -> Iterator[QuietFile]:
    """A new file at `path`. Raises OSError where it cannot be opened, or, after the block, where a write failed."""
    with open(path, "wb+") as file:
        quiet = QuietFile(file.fileno())
        yield quiet
        quiet.check()
