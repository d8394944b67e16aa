"""Checks before a SQLite database is opened that the database and its auxiliary files are plain files."""

from __future__ import annotations

import contextlib
import os
import stat
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.opening import stay_inside
from nvsim.files.regular import refuse_stand_in

_SMALLEST = 1024  # bytes; every database of NVSim is larger
_SUPER = bytes.fromhex("d9d505f920a163d7")  # end of a rollback journal that names another file to delete


def check_files(path: Path) -> None:
    """Checks that a database and its auxiliary files (-wal, -shm, -journal) are plain files without hard links.

    Without the check, SQLite would follow a link, wait at a pipe, or delete files named in a forged journal. Missing
    files are ignored. Raises InputError if a check fails.
    """
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
            what = "a symbolic link" if stat.S_ISLNK(found.st_mode) else "not a plain file, or it has hard links"
            raise InputError(f"{file} is {what}, and NVSim does not open it; replace it with the file itself.")
        if not suffix and 0 < found.st_size < _SMALLEST:
            # Larger files are not opened: closing a second descriptor would release the locks of SQLite.
            refuse_stand_in(file)
        if suffix == "-journal" and found.st_size >= len(_SUPER):
            with contextlib.suppress(OSError), open(file, "rb") as journal:
                journal.seek(-len(_SUPER), os.SEEK_END)
                if journal.read() == _SUPER:
                    raise InputError(f"{file} asks SQLite to change other files; remove it.")
