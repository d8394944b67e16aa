"""Reads a SQLite file if its folder is not writable.

A reader of a database in WAL mode needs a small shared-memory file beside it. SQLite cannot create that file on a full
disk, on a read-only medium, or in a folder of another user.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from pathlib import Path

from nvsim.files.database_files import check_files
from nvsim.files.guarded_database import GuardedConnection

_MEMORY = "/dev/shm"  # has room even if every disk is full


class Snapshot(GuardedConnection):
    """Shows the state of the database at the time of opening, without later commits."""


def open_to_read(path: Path) -> GuardedConnection:
    """A read-only connection to `path`; a Snapshot if SQLite cannot write beside the file. Raises sqlite3.Error, and
    InputError if `path` is not a plain file."""
    check_files(path)
    try:
        return _tried(path, "mode=ro", GuardedConnection)
    except sqlite3.OperationalError:
        wal = path.with_name(path.name + "-wal")
        if not wal.is_file() or wal.stat().st_size == 0:
            return _tried(path, "mode=ro&immutable=1", Snapshot)
        return _copied(path)


def stamp(path: Path) -> tuple[tuple[int, int], ...]:
    """A value that changes when the database is written."""
    found = []
    for name in (path.name, path.name + "-wal"):
        with contextlib.suppress(OSError):
            status = path.with_name(name).stat()
            found.append((status.st_mtime_ns, status.st_size))
    return tuple(found)


def copied(connection: GuardedConnection) -> Snapshot:
    """A copy of the database in memory, which may be changed. Closes `connection`. Raises sqlite3.Error."""
    memory = Snapshot(":memory:", isolation_level=None, check_same_thread=False)
    memory.path = connection.path
    with contextlib.closing(connection):
        connection.backup(memory)
    return memory


def _tried(path: Path, flags: str, kind: type[GuardedConnection]) -> GuardedConnection:
    uri = f"file:{_quoted(path)}?{flags}"
    connection = sqlite3.connect(uri, uri=True, timeout=30, isolation_level=None, check_same_thread=False, factory=kind)
    connection.path = path
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()  # connect() alone reads nothing
    except BaseException:
        connection.close()
        raise
    return connection


def _copied(path: Path) -> Snapshot:
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


def _quoted(path: Path) -> str:
    return str(path.resolve()).replace("%", "%25").replace("?", "%3f").replace("#", "%23")
