"""Opens SQLite files that may be damaged, linked, or in a folder that is not writable, and creates them.

A reader of a database in WAL mode needs a small shared-memory file beside it. SQLite cannot create that file on a
full disk, on a read-only medium, or in a folder of another user.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import sqlite3
import stat
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from nvsim.errors import InputError
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import refuse_links_out_of, refuse_placeholder

_SMALLEST = 1024  # bytes; every database of NVSim is larger
_SUPER = bytes.fromhex("d9d505f920a163d7")  # end of a rollback journal that names another file to delete


def check_files(path: Path) -> None:
    """Checks that a database and its auxiliary files (-wal, -shm, -journal) are plain files without hard links.

    Without the check, SQLite would follow a link, wait at a pipe, or delete files named in a forged journal. Missing
    files are ignored. Raises InputError if a check fails.
    """
    refuse_links_out_of(path.parent)
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
            refuse_placeholder(file)
        if suffix == "-journal" and found.st_size >= len(_SUPER):
            with contextlib.suppress(OSError), open(file, "rb") as journal:
                journal.seek(-len(_SUPER), os.SEEK_END)
                if journal.read() == _SUPER:
                    raise InputError(f"{file} asks SQLite to change other files; remove it.")


T = TypeVar("T")


def damaged_error(path: Path, error: Exception) -> InputError:
    """The error message for a damaged database."""
    words = "".join(c if c.isprintable() else "?" for c in str(error))[:80]
    return InputError(f"{path} is damaged ({words}); restore the project from a copy or import it again.")


class GuardedConnection(sqlite3.Connection):
    """Raises InputError if the file is damaged. A full disk, a lock, or an invalid statement still raises
    sqlite3.Error."""

    path = Path()

    def cursor(self, factory: Any = None) -> Any:
        made = super().cursor(factory or GuardedCursor)
        if isinstance(made, GuardedCursor):
            made.path = self.path
        return made

    def execute(self, sql: str, parameters: Any = (), /) -> Any:
        return self.cursor().execute(sql, parameters)

    def executemany(self, sql: str, parameters: Iterable[Any], /) -> Any:
        return self.cursor().executemany(sql, parameters)

    def executescript(self, script: str, /) -> Any:
        return self.cursor().executescript(script)


class GuardedCursor(sqlite3.Cursor):
    path = Path()

    def execute(self, sql: str, parameters: Any = (), /) -> Any:
        return self._held(super().execute, sql, parameters)

    def executemany(self, sql: str, parameters: Iterable[Any], /) -> Any:
        return self._held(super().executemany, sql, parameters)

    def executescript(self, script: str, /) -> Any:
        return self._held(super().executescript, script)

    def fetchone(self) -> Any:
        return self._held(super().fetchone)

    def fetchall(self) -> list[Any]:
        return self._held(super().fetchall)

    def __next__(self) -> Any:
        return self._held(super().__next__)

    def _held(self, call: Callable[..., T], *arguments: Any) -> T:
        try:
            return call(*arguments)
        except sqlite3.DatabaseError as error:
            if type(error) is sqlite3.DatabaseError:  # its subclasses have other causes
                raise damaged_error(self.path, error) from error
            raise
        except UnicodeDecodeError as error:  # SQLite's own message quotes the damaged text
            raise damaged_error(self.path, error) from error


_MEMORY = "/dev/shm"  # has room even if every disk is full


class Snapshot(GuardedConnection):
    """Shows the state of the database at the time of opening, without later commits."""


def open_to_read(path: Path) -> GuardedConnection:
    """A read-only connection to `path`; a Snapshot if SQLite cannot write beside the file. Raises sqlite3.Error, and
    InputError if `path` is not a plain file."""
    check_files(path)
    try:
        return _try_open(path, "mode=ro", GuardedConnection)
    except sqlite3.OperationalError:
        wal = path.with_name(path.name + "-wal")
        if not wal.is_file() or wal.stat().st_size == 0:
            return _try_open(path, "mode=ro&immutable=1", Snapshot)
        return _copy_to_memory(path)


def stamp(path: Path) -> tuple[tuple[int, int], ...]:
    """A value that changes when the database is written."""
    found = []
    for name in (path.name, path.name + "-wal"):
        with contextlib.suppress(OSError):
            status = path.with_name(name).stat()
            found.append((status.st_mtime_ns, status.st_size))
    return tuple(found)


def copy_to_memory(connection: GuardedConnection) -> Snapshot:
    """A copy of the database in memory, which may be changed. Closes `connection`. Raises sqlite3.Error."""
    memory = Snapshot(":memory:", isolation_level=None, check_same_thread=False)
    memory.path = connection.path
    with contextlib.closing(connection):
        connection.backup(memory)
    return memory


def _try_open(path: Path, flags: str, kind: type[GuardedConnection]) -> GuardedConnection:
    uri = f"file:{_quote_name(path)}?{flags}"
    connection = sqlite3.connect(uri, uri=True, timeout=30, isolation_level=None, check_same_thread=False, factory=kind)
    connection.path = path
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()  # connect() alone reads nothing
    except BaseException:
        connection.close()
        raise
    return connection


def _copy_to_memory(path: Path) -> Snapshot:
    """A copy in memory, with the commits that a crashed process left in the -wal file."""
    failure: OSError | sqlite3.Error | None = None
    for place in (tempfile.gettempdir(), _MEMORY):
        try:
            with tempfile.TemporaryDirectory(prefix="nvsim-reading-", dir=place) as name:
                copy = Path(name) / "copy.db"
                for suffix in ("", "-wal"):
                    shutil.copyfile(path.with_name(path.name + suffix), copy.with_name(copy.name + suffix))
                memory = Snapshot(":memory:", isolation_level=None, check_same_thread=False)
                memory.path = path
                with contextlib.closing(sqlite3.connect(copy)) as whole:
                    whole.backup(memory)
                memory.execute("PRAGMA query_only=1")
                return memory
        except (OSError, sqlite3.Error) as error:
            failure = error
    raise sqlite3.OperationalError(f"no disk has room for a temporary copy to read ({failure})")


def _quote_name(path: Path) -> str:
    return str(path.resolve()).replace("%", "%25").replace("?", "%3f").replace("#", "%23")


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


def sqlite_error(path: Path, error: sqlite3.Error) -> InputError:
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
