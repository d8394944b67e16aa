"""Creates SQLite files with the permissions of the umask, and explains refused writes."""

from __future__ import annotations

import errno
import os
import sqlite3
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error

_READ_ONLY = (sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_PERM)


def make_file(path: Path) -> None:
    """Creates an empty file if there is none; SQLite treats it as a new database. SQLite itself would make a file that
    only its owner can write, so that users could not share it. Raises InputError if the disk reports an error."""
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    try:
        os.close(os.open(path, flags, 0o666))
    except FileExistsError:
        pass
    except OSError as error:
        raise as_input_error(path, error) from error


def refused(path: Path, error: sqlite3.Error) -> InputError:
    """The error message for a SQLite error while the database at `path` is opened or written."""
    text, code = str(error), getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_FULL or "full" in text:
        return as_input_error(path, OSError(errno.ENOSPC, "No space left on device"))
    if code in _READ_ONLY or "readonly" in text:
        for file in (path, *(path.with_name(path.name + end) for end in ("-wal", "-shm", "-journal")), path.parent):
            if file.exists() and not os.access(file, os.W_OK):
                never = os.statvfs(file).f_flag & os.ST_RDONLY
                return as_input_error(file, OSError(errno.EROFS if never else errno.EACCES, text))
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED) or "locked" in text:
        return InputError(f"Cannot write {path}: another program has locked it; close that program and try again.")
    if code in (sqlite3.SQLITE_IOERR, sqlite3.SQLITE_PROTOCOL):
        return InputError(
            f"Cannot write {path}: {text}; the disk fails, or it is a network file system that cannot lock files. Use "
            "a folder on another disk."
        )
    return InputError(f"Cannot write {path}: {text}; check that the folder is writable and the disk has free space.")
