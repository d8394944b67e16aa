"""The project's SQLite database: schema, versions, opening for writing and for reading.

WAL mode with synchronous=FULL: committed data survives a kill and a power failure.
"""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files import tables
from nvsim.files.databases import (
    GuardedConnection,
    check_files,
    copy_to_memory,
    damaged_error,
    make_file,
    open_to_read,
    sqlite_error,
)
from nvsim.files.tables import COUNT, NUMBER, TEXT, check_schema, disable_code
from nvsim.project.state.results import (
    Slot,
    StagePart,
    StageResult,
    StageResults,
    UnfinishedPart,
    files_inside_project,
    write,
)
from nvsim.project.work import STAGES

VERSION = 5

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

_MIGRATIONS = {
    1: _SCHEMA,
    2: """
ALTER TABLE viewpoints ADD COLUMN reviewed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE viewpoints ADD COLUMN locked INTEGER NOT NULL DEFAULT 0;
ALTER TABLE edges ADD COLUMN reviewed INTEGER NOT NULL DEFAULT 0;
ALTER TABLE edges ADD COLUMN locked INTEGER NOT NULL DEFAULT 0;
CREATE TABLE ignored (seq INTEGER PRIMARY KEY, key TEXT NOT NULL UNIQUE, reason TEXT NOT NULL);
""",
    # Version 3 stores results in numbered folders, which an older program would not find.
    3: "",
    # The results of the stages move from JSON in the table `meta` to columns, see `results`.
    4: """
ALTER TABLE viewpoints ADD COLUMN photographed REAL;
CREATE TABLE stage_parts (
    slot TEXT NOT NULL, stage TEXT NOT NULL, part INTEGER NOT NULL, key TEXT NOT NULL, seconds REAL NOT NULL,
    finished REAL NOT NULL, figures TEXT NOT NULL, version TEXT NOT NULL, settings TEXT NOT NULL, batch TEXT NOT NULL,
    PRIMARY KEY (slot, stage, part));
CREATE TABLE stage_files (slot TEXT NOT NULL, stage TEXT NOT NULL, name TEXT NOT NULL, place TEXT NOT NULL,
    PRIMARY KEY (slot, stage, name));
CREATE TABLE unfinished (stage TEXT NOT NULL, part INTEGER NOT NULL, key TEXT NOT NULL, number INTEGER NOT NULL,
    PRIMARY KEY (stage, part));
CREATE TABLE generation (number INTEGER NOT NULL);
DROP TABLE stages;
DELETE FROM meta WHERE key IN ('places', 'generation', 'capture_config', 'batch train') OR key LIKE 'previous %'
    OR key LIKE 'next %' OR key LIKE 'work %';
""",
    # Commands are recorded as jobs in logs/jobs.
    5: "DROP TABLE jobs;",
}
"""Version -> statements that update a database of the previous version. A new database runs all of them."""


def create(path: Path) -> sqlite3.Connection:
    """A new database at `path`. Raises InputError if it cannot be written."""
    check_files(path)
    make_file(path)
    try:
        connection = _connect(path)
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=FULL")
        update(connection, path, 0)
    except sqlite3.Error as error:
        raise sqlite_error(path, error) from error
    return connection


def update(connection: sqlite3.Connection, path: Path, version: int) -> None:
    """Updates a database of `version`, or an empty one of version 0, in one transaction. A kill leaves the database as
    it was. Raises sqlite3.Error, and InputError if the database is damaged."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        former = _version_3(connection, path) if 0 < version < 4 else None
        for number in range(version + 1, VERSION + 1):
            for statement in _MIGRATIONS[number].split(";"):
                connection.execute(statement)
        if former is not None:
            write(connection, former)
        connection.execute(f"PRAGMA user_version={VERSION}")
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def _connect(path: Path) -> GuardedConnection:
    connection = sqlite3.connect(
        path, timeout=30, isolation_level=None, check_same_thread=False, factory=GuardedConnection
    )
    connection.path = path
    return connection


def connect_database(path: Path, read_only: bool) -> sqlite3.Connection:
    """The database of an existing project. A reader of an older version gets an updated copy in memory. Raises
    InputError if the database is missing, damaged, or of a newer version."""
    check_files(path)
    if not path.is_file():
        raise InputError(f"{path.parent} is not an NVSim project: it has no {path.name}; `nvsim import` makes one.")
    try:
        connection = open_to_read(path) if read_only else _connect(path)
        version = check(connection, path, read_only)
        if version == 0 and not read_only:
            connection.close()
            return create(path)
        if read_only and version < VERSION:
            connection = copy_to_memory(connection)
            update(connection, path, _version(connection))  # a writer may have updated it in the meantime
            connection.execute("PRAGMA query_only=1")
        if not read_only:
            connection.execute("PRAGMA journal_mode=WAL")
            connection.execute("PRAGMA synchronous=FULL")
            if version < VERSION:
                update(connection, path, version)
    except sqlite3.OperationalError as error:
        if not read_only:
            raise sqlite_error(path, error) from error
        raise InputError(f"Cannot open {path}: {error}; check whether it is readable.") from error
    except sqlite3.DatabaseError as error:
        raise damaged_error(path, error) from error
    return connection


def check(connection: sqlite3.Connection, path: Path, read_only: bool) -> int:
    """The version of the database, after a check that it has exactly the tables of that version.

    0 means that it is empty, which only a writer may open. Raises InputError and closes the connection if the check
    fails. Raises sqlite3.Error if the file is not a database.
    """
    try:
        disable_code(connection)
        version = _version(connection)
        if version > VERSION:
            raise InputError(
                f"{path.parent} was written by a newer NVSim (project version {version}, this program reads up to "
                f"{VERSION}); update NVSim to open it."
            )
        if version == 0 and connection.execute("SELECT 1 FROM sqlite_master").fetchone() is None:
            if read_only:
                raise InputError(f"{path} is empty, because a program was stopped when it started; import again.")
            return 0
        check_schema(connection, path, "".join(_MIGRATIONS[v] for v in range(1, version + 1)))
    except InputError:
        connection.close()
        raise
    return version


def _version(connection: sqlite3.Connection) -> int:
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


# Version 3: the results of the stages were JSON in the table `meta` ---------------------------------------------------

_ROW = {"stage": TEXT, "part": COUNT, "key": TEXT, "seconds": NUMBER, "finished": NUMBER.or_null, "summary": TEXT}
_STAGE_OF = {"imported": "import", "depth": "depth", "masks": "floors", "floor": "floors"}


def _version_3(c: sqlite3.Connection, path: Path) -> StageResults:
    """The results in the database at `path`. Skips damaged values of the table `meta`. Raises InputError if the table
    `stages` is damaged."""
    meta: dict[str, str] = dict(tables.read(c, path, "meta", {"key": TEXT, "value": TEXT}))
    found: dict[str, dict[int, StagePart]] = {}
    for stage, part, key, seconds, finished, summary in tables.read(c, path, "stages", _ROW, "WHERE state = 'done'"):
        found.setdefault(stage, {})[part] = StagePart(key, seconds, finished or 0.0, summary)
    if "import" in found and 0 in found["import"]:
        found["import"][0] = replace(found["import"][0], settings=meta.get("capture_config", ""))
    batch = _object(meta.get("batch train"))
    for part, row in found.get("train", {}).items():
        if isinstance(batch.get("submaps"), list) and part in batch["submaps"]:
            found["train"][part] = replace(row, batch=str(batch.get("batch", "")))
    files: dict[str, dict[str, str]] = {}
    for name, place in files_inside_project(_object(meta.get("places"))).items():
        stage = name.removeprefix("cut/") if name.startswith("cut/") else _STAGE_OF.get(name, "train")
        files.setdefault(stage, {})[name] = place
    results: dict[tuple[Slot, str], StageResult] = {
        ("in use", stage): StageResult(found.get(stage, {}), files.get(stage, {}))
        for stage in found.keys() | files.keys()
    }
    slots: tuple[Slot, ...] = ("previous", "next")
    for slot in slots:
        for stage in STAGES:
            result = _result(_object(meta.get(f"{slot} {stage}")))
            if result is not None:
                results[slot, stage] = result
    # Versions below 3 stored unfinished work in the row of the result.
    begun = tables.read(c, path, "stages", {"stage": TEXT, "part": COUNT, "key": TEXT}, "WHERE state != 'done'")
    unfinished = {(stage, part): UnfinishedPart(key) for stage, part, key in begun}
    for name, text in meta.items():
        kind, _, rest = name.partition(" ")
        stage, _, number = rest.partition(" ")
        work = _object(text) if kind == "work" and number.isdecimal() else {}
        if isinstance(work.get("key"), str) and isinstance(work.get("number"), int):
            unfinished[stage, int(number)] = UnfinishedPart(work["key"], work["number"])
    generation = meta.get("generation", "0")
    return StageResults(results, unfinished, int(generation) if generation.isdecimal() else 0)


def _result(data: dict[str, Any]) -> StageResult | None:
    """A result that is not in use, None if it is damaged."""
    try:
        parts = {
            int(number): StagePart(
                str(row["key"]), float(row["seconds"]), float(row["finished"]), json.dumps(dict(row["summary"]))
            )
            for number, row in data["rows"].items()
        }
        values = dict(data["values"])
        files = dict(data["places"]) | ({"graph": values["graph"]} if "graph" in values else {})
        if not all(isinstance(text, str) for text in values.values()):
            return None
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    if 0 in parts:
        parts[0] = replace(parts[0], settings=values.get("capture_config", ""))
    return StageResult(parts, files_inside_project(files))


def _object(text: str | None) -> dict[str, Any]:
    try:
        found = json.loads(text or "{}")
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
