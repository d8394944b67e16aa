"""SQLite files that are written: made with the permissions of the umask, and why a write was refused."""

from __future__ import annotations

import errno
import os
import sqlite3
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error

_READ_ONLY = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM)


def make_file(path: Path) -> None:
    """Makes an empty file, which SQLite takes for a new database, if there is none. SQLite itself makes files that only
    their owner can write, so that nobody could share them. Raises InputError if the disk refuses."""
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    try:
        os.close(os.open(path, flags, 0o666))
    except FileExistsError:
        pass
    except OSError as error:
        raise as_input_error(path, error) from error


def refused(path: Path, error: sqlite3.Error) -> InputError:
    """The sentence for an error while the database at `path` is opened or written."""
    text, code = str(error), getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_FULL or "full" in text:
        return as_input_error(path, OSError(errno.ENOSPC, "No space left on device"))
    if code in _READ_ONLY or "readonly" in text:
        for file in (path, *(path.with_name(path.name + end) for end in ("-wal", "-shm", "-journal")), path.parent):
            if file.exists() and not os.access(file, os.W_OK):
                never = os.statvfs(file).f_flag & os.ST_RDONLY
                return as_input_error(file, OSError(errno.EROFS if never else errno.EACCES, text))
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED) or "locked" in text:
        return InputError(f"Cannot write {path}: another program holds it; close that program and try again.")
    if code in (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_PROTOCOL):
        return InputError(
            f"Cannot write {path}: {text}; the disk fails, or it is a network file system that cannot lock files, so "
            "use a folder on another disk."
        )
    return InputError(f"Cannot write {path}: {text}; check that the folder can be written and its disk has room.")
