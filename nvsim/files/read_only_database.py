"""Reads a SQLite file where nothing can be written.

A reader of a database in WAL mode needs a small file of shared memory beside it. On a full disk, on a read-only medium
and in a folder of somebody else's it cannot be made, and yet one wants to look.
"""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import tempfile
from pathlib import Path

from nvsim.files.database_files import check_files
from nvsim.files.guarded_database import GuardedConnection

_MEMORY = "/dev/shm"  # where there is room when every disk is full


class Snapshot(GuardedConnection):
    """Shows the database as it was when it was opened, without what is committed later."""


def open_to_read(path: Path) -> GuardedConnection:
    """A connection to read `path` with, a Snapshot where nothing can be written beside the file. Raises sqlite3.Error,
    and InputError for what is no plain file."""
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


def _tried(path: Path, flags: str, kind: type[GuardedConnection]) -> GuardedConnection:
    uri = f"file:{_quoted(path)}?{flags}"
    connection = sqlite3.connect(uri, uri=True, timeout=30, isolation_level=None, check_same_thread=False, factory=kind)
    connection.path = path
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()  # opening alone touches nothing
    except BaseException:
        connection.close()
        raise
    return connection


def _copied(path: Path) -> Snapshot:
    """In memory, with what the process that died had committed to the file beside it (-wal)."""
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
    raise sqlite3.OperationalError(f"there is no room anywhere for a copy of it to read ({failure})")


def _quoted(path: Path) -> str:
    return str(path.resolve()).replace("%", "%25").replace("?", "%3f").replace("#", "%23")
