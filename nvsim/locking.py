"""One writer at a time: a lock that the operating system releases when its holder dies."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import IO

from nvsim.atomic import as_input_error
from nvsim.errors import InputError


class Held(InputError):
    """Another process holds the lock."""


class WriterLock:
    """Held from construction until `release` or the end of the process, however it ends."""

    def __init__(self, path: Path) -> None:
        """Raises Held when another process (or another part of this one) holds the lock, InputError when the folder
        cannot be written."""
        try:
            self._file: IO[str] | None = open(path, "a+")  # noqa: SIM115 (held for the lock's life)
        except OSError as error:
            raise as_input_error(path, error) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self._file.seek(0)
            holder = self._file.read().strip() or "unknown"
            self._file.close()
            raise Held(
                f"{path.parent} is being written by another NVSim process (pid {holder}); wait for it or stop it."
            ) from error
        self._file.seek(0)
        self._file.truncate()
        self._file.write(str(os.getpid()))
        self._file.flush()

    def release(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
