"""A file for h5py that records the first failed write and raises it later.

If a write fails, the HDF5 library prints a traceback for each object that it closes, and may end the process with a
segmentation fault. This file reports success to the library, and the caller discards the file.
"""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class QuietFile(io.RawIOBase):
    """Reads and writes the file of a descriptor. Failed writes are reported by `check` only."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._at = descriptor, 0
        self._error: OSError | None = None

    def check(self) -> None:
        """Raises OSError if a write has failed."""
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
    """Yields a new file at `path`. Raises OSError if opening fails, or after the block if a write failed."""
    with open(path, "wb+") as file:
        quiet = QuietFile(file.fileno())
        yield quiet
        quiet.check()
