"""Regular files only: a pipe, a device or a folder in the place of one is refused before it is opened, so that no
reader ever waits for it."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from nvsim.errors import InputError
from nvsim.reading import as_reading_error


@contextmanager
def regular_file(path: Path) -> Iterator[BinaryIO]:
    """`path`, open for reading. Raises InputError when it is not a regular file or cannot be opened."""
    try:
        mode = os.stat(path).st_mode
        if stat.S_ISDIR(mode):
            raise InputError(f"Cannot read {path}: it is a folder, not a file; name the file in it.")
        if not stat.S_ISREG(mode):
            raise InputError(f"{path} is not a file that can be read; name a regular file.")
        file = open(path, "rb", opener=_without_waiting)  # noqa: SIM115 (closed below)
    except OSError as error:
        raise as_reading_error(path, error) from error
    except ValueError as error:  # a name that no file can have: with a NUL, or not in the system's encoding
        raise InputError(f"{str(path)!r} cannot be the name of a file; check the path.") from error
    with file:
        yield file


def whole_file(path: Path, most: int | None = None) -> bytes:
    """The bytes of `path`, perhaps none. Raises InputError when it is not a regular file, cannot be read, or is longer
    than `most` bytes."""
    with regular_file(path) as file:
        try:
            data = file.read() if most is None else file.read(most + 1)
        except OSError as error:
            raise as_reading_error(path, error) from error
    if most is not None and len(data) > most:
        raise InputError(f"{path} is longer than {most} bytes, more than such a file ever is; name another.")
    return data


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))
