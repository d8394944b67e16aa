"""SQLite files: damaged pages, and cells, columns, and tables changed by SQL after their constraints are removed."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import tempfile
from typing import Any

from fuzzing import archives, trees
from fuzzing.damage import Damage

_VALUES: tuple[Any, ...] = (
    *(
        None,
        0,
        1,
        -1,
        2,
        2**31,
        2**63 - 1,
        -(2**63),
        0.5,
        float("inf"),
        -1e308,
        "",
        "x",
        "\0",
        "0",
        "1e999",
        "{}",
        "[]",
    ),
    *("null", "[[", "nan", b"", b"\0", b"\xff" * 40, b"[]", b"PK\x05\x06" + b"\0" * 18, "x" * 100_000, "[" * 20_000),
    *("<img src=x>", "../../../etc/passwd", "9" * 5000, "running", "done", "person"),
)


def database(d: Damage, data: bytes) -> bytes:
    if d.dice.random() < 0.3:
        return _pages(d, data)
    handle, name = tempfile.mkstemp(suffix=".db")
    try:
        os.write(handle, data)
        os.close(handle)
        connection = sqlite3.connect(name, isolation_level=None)
        try:
            connection.execute("PRAGMA journal_mode=OFF")
            connection.execute("PRAGMA synchronous=OFF")
            connection.text_factory = lambda b: b.decode("utf-8", "surrogateescape")
            with contextlib.suppress(sqlite3.Error, OverflowError, UnicodeError):
                _by_sql(d, connection)
        finally:
            connection.close()
        with open(name, "rb") as file:
            return file.read()
    except sqlite3.Error:
        return d.bytes(data)
    finally:
        os.unlink(name)


def _pages(d: Damage, data: bytes) -> bytes:
    page = 4096
    if len(data) < 2 * page or d.dice.random() < 0.5:
        return d.bytes(data)
    at = d.dice.randrange(len(data) // page) * page
    other = d.dice.randrange(len(data) // page) * page
    what = d.dice.choice(("zeroed", "noise", "another", "head"))
    d.say(f"page {at // page} {what}")
    if what == "another":
        return data[:at] + data[other : other + page] + data[at + page :]
    if what == "head":
        return data[:at] + d.bytes(data[at : at + page]).ljust(page, b"\0")[:page] + data[at + page :]
    return data[:at] + (bytes(page) if what == "zeroed" else d.dice.randbytes(page)) + data[at + page :]


def _by_sql(d: Damage, c: sqlite3.Connection) -> None:
    tables = [row[0] for row in c.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")]
    if not tables:
        return
    table = d.dice.choice(tables)
    columns = [row[1] for row in c.execute(f"PRAGMA table_info({table})")]
    column = d.dice.choice(columns)
    what = d.dice.choice(("cell",) * 10 + ("rows gone", "rows twice", "table gone", "column gone", "version", "view"))
    d.say(f"{table}.{column} {what}")
    if what == "version":
        c.execute(f"PRAGMA user_version={d.dice.choice((0, 1, 2, 3, 99, -1, 2**31 - 1))}")
    elif what == "table gone":
        c.execute(f"DROP TABLE {table}")
    elif what == "column gone":
        _loosen(c, table)
        c.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
    elif what == "rows gone":
        c.execute(f"DELETE FROM {table} WHERE rowid % ? = 0", (d.dice.choice((1, 2, 3)),))
    elif what == "rows twice":
        _loosen(c, table)
        c.execute(f"INSERT INTO {table} SELECT * FROM {table}")
    elif what == "view":
        c.execute(f"ALTER TABLE {table} RENAME TO held")
        c.execute(f"CREATE VIEW {table} AS SELECT * FROM {table}")
    else:
        _cell(d, c, table, column)


def _cell(d: Damage, c: sqlite3.Connection, table: str, column: str) -> None:
    rows = [row[0] for row in c.execute(f"SELECT rowid FROM {table}")]
    if not rows:
        return
    row = d.dice.choice(rows)
    found = c.execute(f"SELECT {column} FROM {table} WHERE rowid = ?", (row,)).fetchone()
    if found is None:
        return
    old = found[0]
    value: Any = d.dice.choice(_VALUES)
    if isinstance(old, bytes) and d.dice.random() < 0.75:
        value = _blob(d, old)
    elif isinstance(old, str) and old[:1] in "{[" and d.dice.random() < 0.7:
        value = trees.json_tree(d, old.encode()).decode("utf-8", "replace")
    d.say(f"row {row} is {value!r:.60}")
    _loosen(c, table)
    c.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (value, row))


def _blob(d: Damage, old: bytes) -> bytes:
    if old[:2] == b"PK":
        return archives.zipped(d, old)
    if old[:5] and old[5:6] == b"{":
        return archives.evidence(d, old)
    return archives.deflated(d, old)


def _loosen(c: sqlite3.Connection, table: str) -> None:
    """Copies the rows to a table without types, keys, and constraints, as another program could write it."""
    rows = [row[0] for row in c.execute(f"SELECT rowid FROM {table}")]
    c.execute(f"CREATE TABLE loose AS SELECT * FROM {table}")
    c.execute(f"DROP TABLE {table}")
    c.execute(f"ALTER TABLE loose RENAME TO {table}")
    for new, old in reversed(list(enumerate(rows, 1))):
        if new != old:
            c.execute(f"UPDATE {table} SET rowid = ? WHERE rowid = ?", (old, new))
