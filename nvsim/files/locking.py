"""A lock for one writer at a time. The operating system releases it when the process ends."""

from __future__ import annotations

import errno
import fcntl
import os
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import plain_file


class AlreadyLocked(InputError):
    """Another process holds the lock."""


class WriterLock:
    """Held from construction until `release` or the end of the process, even after a crash."""

    def __init__(self, path: Path) -> None:
        """Raises Held if another process (or another part of this one) holds the lock. Raises InputError if the folder
        is not writable or the lock is not a plain file."""
        try:
            if path.exists() and not os.access(path.parent, os.W_OK):  # the guarded files are created in this folder
                never = os.statvfs(path.parent).f_flag & os.ST_RDONLY
                raise OSError(errno.EROFS if never else errno.EACCES, "it cannot be written")
            descriptor = plain_file(path, os.O_RDWR | os.O_CREAT)
        except OSError as error:
            raise as_input_error(path, error) from error
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.pread(descriptor, 32, 0).decode(errors="replace").strip() or "unknown"
            os.close(descriptor)
            raise AlreadyLocked(
                f"{path.parent} is being written by another NVSim process (pid {holder}); wait for it or stop it."
            ) from error
        except OSError as error:
            os.close(descriptor)
            raise as_input_error(path, error) from error
        self._descriptor: int | None = descriptor
        try:
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, str(os.getpid()).encode(), 0)
        except OSError as error:  # for example a full disk, on which the guarded files could not be written either
            self.release()
            raise as_input_error(path, error) from error

    def release(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
