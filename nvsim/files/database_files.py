"""What may be a SQLite database on disk: a file of its own, and so are those that SQLite keeps beside it."""

from __future__ import annotations

import contextlib
import os
import stat
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.opening import stay_inside
from nvsim.files.regular import refuse_stand_in

_SMALLEST = 1024  # bytes; every database of NVSim is larger
_SUPER = bytes.fromhex("d9d505f920a163d7")  # ends a rollback journal that names another file to be deleted


def check_files(path: Path) -> None:
    """Checks before a database is opened that the file and those that SQLite keeps beside it are files of their own.
    SQLite follows a link, waits at a pipe, and deletes what a prepared journal names. Raises InputError; a file may be
    missing."""
    stay_inside(path.parent)
    for suffix in ("", "-wal", "-shm", "-journal"):
        file = path.with_name(path.name + suffix)
        try:
            found = os.lstat(file)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise InputError(f"Cannot read {file}: {error.strerror}; check the path.") from error
        if not stat.S_ISREG(found.st_mode) or found.st_nlink > 1:
            what = "a symbolic link" if stat.S_ISLNK(found.st_mode) else "no file of its own"
            raise InputError(f"{file} is {what}, which is not opened here; put the file itself in its place.")
        if not suffix and 0 < found.st_size < _SMALLEST:
            # A larger file is left alone: closing a second descriptor would release the locks that SQLite holds on it.
            refuse_stand_in(file)
        if suffix == "-journal" and found.st_size >= len(_SUPER):
            with contextlib.suppress(OSError), open(file, "rb") as journal:
                journal.seek(-len(_SUPER), os.SEEK_END)
                if journal.read() == _SUPER:
                    raise InputError(f"{file} names other files to be changed with it; remove it.")
