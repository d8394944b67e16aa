"""Opens untrusted paths safely: only regular files, never links, pipes or devices.

Opening a pipe could wait forever, a device may never end, and a link may lead to an unintended file. They are refused
before they are opened, because opening can already have an effect.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


def open_regular(path: Path, flags: int = os.O_RDONLY, mode: int = 0o666) -> int:
    """A descriptor of the file at `path`. A file to be written must not have hard links. Raises OSError: ELOOP for a
    link, EINVAL for other paths that are not regular files."""
    try:
        _check(os.lstat(path), path, flags)
    except FileNotFoundError:
        if not flags & os.O_CREAT:
            raise
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, mode)
    try:
        _check(os.fstat(descriptor), path, flags)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_regular(path: Path, most: int) -> bytes:
    """The complete content of the file at `path`. Raises OSError like `open_regular`, and EFBIG if the file has more
    than `most` bytes."""
    with open(open_regular(path), "rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    return data


def read_end(path: Path, most: int) -> bytes:
    """The last `most` bytes of the file at `path`. Raises OSError like `open_regular`."""
    with open(open_regular(path), "rb") as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - most))
        return file.read(most)


def is_folder(path: Path) -> bool:
    """Whether `path` is a folder and not a link to one."""
    try:
        return stat.S_ISDIR(os.lstat(path).st_mode)
    except (OSError, ValueError):
        return False


def _check(found: os.stat_result, path: Path, flags: int) -> None:
    if stat.S_ISLNK(found.st_mode):
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is not a file", str(path))
    if flags & (os.O_WRONLY | os.O_RDWR) and found.st_nlink > 1:
        raise OSError(errno.EINVAL, "the file has a hard link elsewhere", str(path))
