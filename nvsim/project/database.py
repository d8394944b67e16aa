"""The project's SQLite database: schema, versions, opening for writing and for reading.

WAL mode with synchronous=FULL: committed data survives a kill and a power failure.
"""

from __future__ import annotations

import sqlite3
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files.database_files import check_files
from nvsim.files.database_writing import make_file, refused
from nvsim.files.guarded_database import GuardedConnection, damaged
from nvsim.files.read_only_database import open_to_read
from nvsim.files.tables import check_schema, harden

VERSION = 4

_SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE stages (
    stage TEXT NOT NULL, part INTEGER NOT NULL, key TEXT NOT NULL, state TEXT NOT NULL,
    seconds REAL NOT NULL DEFAULT 0, finished REAL, summary TEXT NOT NULL DEFAULT '{}',
    PRIMARY KEY (stage, part));
CREATE TABLE submap_frames (submap INTEGER NOT NULL, frame INTEGER NOT NULL, core INTEGER NOT NULL,
    PRIMARY KEY (submap, frame));
CREATE TABLE viewpoints (
    seq INTEGER PRIMARY KEY, id TEXT NOT NULL UNIQUE, x REAL NOT NULL, y REAL NOT NULL, z REAL NOT NULL,
    height REAL NOT NULL, submap INTEGER NOT NULL, included INTEGER NOT NULL, origin TEXT NOT NULL);
CREATE TABLE edges (seq INTEGER PRIMARY KEY, a TEXT NOT NULL, b TEXT NOT NULL, origin TEXT NOT NULL, UNIQUE (a, b));
CREATE TABLE evidence (
    seq INTEGER PRIMARY KEY, viewpoint TEXT NOT NULL, direction INTEGER NOT NULL, data BLOB NOT NULL,
    UNIQUE (viewpoint, direction));
CREATE TABLE jobs (
    id INTEGER PRIMARY KEY, stage TEXT NOT NULL, pid INTEGER NOT NULL, state TEXT NOT NULL, started REAL NOT NULL,
    updated REAL NOT NULL, finished REAL, done INTEGER NOT NULL DEFAULT 0, total INTEGER NOT NULL DEFAULT 0,
    message TEXT NOT NULL DEFAULT '');
CREATE TABLE results (name TEXT PRIMARY KEY, created REAL NOT NULL, figures TEXT NOT NULL);
"""

# Version -> statements that update a database of the previous version. A new database runs all of them.
_MIGRATIONS = {
    2: """
ALTER TABLE viewpoints ADD COLUMN reviewed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE viewpoints ADD COLUMN locked INTEGER NOT NULL DEFAULT 0;
ALTER TABLE edges ADD COLUMN reviewed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE edges ADD COLUMN locked INTEGER NOT NULL DEFAULT 0;
CREATE TABLE ignored (seq INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, reason TEXT NOT NULL);
""",
    # Results may be in numbered folders, which the table `meta` names (see `results`). An older program would use a
    # replaced result.
    3: "",
    4: "ALTER TABLE viewpoints ADD COLUMN photographed REAL;",
}


def create(path: Path) -> sqlite3.Connection:
    """A new database at `path`. Raises InputError if it cannot be written."""
    check_files(path)
    make_file(path)
    try:
        connection = _connected(path)
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        # One transaction: a kill leaves either an empty database, which `connect` treats as new, or a complete schema.
        lay_out(connection)
    except sqlite3.Error as error:
        raise refused(path, error) from error
    return connection


def lay_out(connection: sqlite3.Connection) -> None:
    """Creates the tables in an empty database. Raises sqlite3.Error."""
    connection.executescript(f"BEGIN; {_SCHEMA} {_since(1)} COMMIT;")


def _connected(path: Path) -> GuardedConnection:
    connection = sqlite3.connect(
        path, timeout=30, isolation_level=None, check_same_thread=False, factory=GuardedConnection
    )
    connection.path = path
    return connection


def connect(path: Path, read_only: bool) -> sqlite3.Connection:
    """The database of an existing project. Raises InputError if it is missing, damaged, or of a newer version."""
    check_files(path)
    if not path.is_file():
        raise InputError(f"{path.parent} is not an NVSim project: it has no {path.name}; `nvsim import` makes one.")
    try:
        if read_only:
            connection = open_to_read(path)
        else:
            check_files(path)
            connection = _connected(path)
        version = check(connection, path, read_only)
        if version == 0 and not read_only:
            connection.close()
            return create(path)
        if not read_only:
            connection.execute("PRAGMA journal_mode=WAL")
            connection.execute("PRAGMA synchronous=FULL")
            if version < VERSION:
                connection.executescript(f"BEGIN IMMEDIATE; {_since(version)} COMMIT;")
                version = VERSION
    except sqlite3.OperationalError as error:
        if not read_only:
            raise refused(path, error) from error
        raise InputError(f"Cannot open {path}: {error}; check whether it is readable.") from error
    except sqlite3.DatabaseError as error:
        raise damaged(path, error) from error
    return connection


def check(connection: sqlite3.Connection, path: Path, read_only: bool) -> int:
    """The version of the database, after a check that it has exactly the tables of that version.

    0 means that it is empty, which only a writer may open. Raises InputError and closes the connection if the check
    fails. Raises sqlite3.Error if the file is not a database.
    """
    try:
        harden(connection)
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        if version > VERSION:
            raise InputError(
                f"{path.parent} was written by a newer NVSim (project version {version}, this program reads up to "
                f"{VERSION}); update NVSim to open it."
            )
        if version == 0 and connection.execute("SELECT 1 FROM sqlite_master").fetchone() is None:
            if read_only:
                raise InputError(f"{path} is empty, because a program was stopped when it started; import again.")
            return 0
        check_schema(connection, path, _SCHEMA + "".join(_MIGRATIONS[v] for v in range(2, version + 1)))
    except InputError:
        connection.close()
        raise
    return version


def _since(version: int) -> str:
    """The statements that update a database of `version`. Run them in one transaction."""
    steps = [_MIGRATIONS[v] for v in range(version + 1, VERSION + 1)]
    return "".join([*steps, f" PRAGMA user_version={VERSION};"])
