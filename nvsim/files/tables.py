"""Reads untrusted SQLite files: only files with exactly NVSim's tables are opened, within limits, and each cell is
checked.

A hostile file may have a view or a virtual table that runs forever, or a trigger that changes data. A damaged file may
have damaged pages, or texts instead of numbers. Each of these raises InputError with one sentence.
"""

from __future__ import annotations

import contextlib
import functools
import math
import sqlite3
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

from nvsim.errors import InputError

SECONDS = 60.0  # limit for one read; the graph of a large building needs several
_STEPS = 20_000  # virtual machine instructions of SQLite between two checks of the clock and of signals
_LIMITS = {
    sqlite3.SQLITE_LIMIT_LENGTH: 512 << 20,  # bytes of a cell
    sqlite3.SQLITE_LIMIT_COLUMN: 64,
    sqlite3.SQLITE_LIMIT_COMPOUND_SELECT: 4,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 50,
    sqlite3.SQLITE_LIMIT_TRIGGER_DEPTH: 1,
    sqlite3.SQLITE_LIMIT_ATTACHED: 1,  # VACUUM needs one
}

Row = tuple[Any, ...]


def disable_code(connection: sqlite3.Connection) -> None:
    """Disables all code that the file defines, and makes SQLite check each page that it reads. Raises sqlite3.Error."""
    for limit, value in _LIMITS.items():
        connection.setlimit(limit, value)
    connection.execute("PRAGMA trusted_schema=OFF")
    connection.execute("PRAGMA cell_size_check=ON")
    connection.execute("PRAGMA mmap_size=0")


def check_schema(connection: sqlite3.Connection, path: Path, script: str) -> None:
    """Raises InputError unless the database has exactly the tables that `script` creates."""
    with reading_rows(connection, path):
        found = {(type, name): _words(sql) for type, name, sql in connection.execute(_SCHEMA_OF)}
    wanted = _made_by(script)
    for (type, name), sql in found.items():
        if (type, name) not in wanted:
            raise InputError(f"{path} has the {_plain(type)} {_plain(name)}, which NVSim does not create; {_AGAIN}.")
        if sql != wanted[type, name]:
            raise InputError(f"{path} has a table {_plain(name)} that differs from NVSim's; {_AGAIN}.")
    for type, name in wanted:
        if (type, name) not in found:
            raise InputError(f"{path} lacks the {type} {name}; {_AGAIN}.")


_AGAIN = "restore it from a copy or make it again"
_SCHEMA_OF = "SELECT type, name, sql FROM sqlite_master LIMIT 1000"


@functools.cache
def _made_by(script: str) -> dict[tuple[str, str], str]:
    with contextlib.closing(sqlite3.connect(":memory:")) as connection:
        connection.executescript(script)
        return {(type, name): _words(sql) for type, name, sql in connection.execute(_SCHEMA_OF)}


def _words(sql: object) -> str:
    return " ".join(str(sql).split())


def _plain(text: object) -> str:
    """A name from a file, shortened for a message."""
    shown = "".join(c if c.isprintable() else "?" for c in str(text))
    return shown if len(shown) <= 40 else shown[:37] + "..."


# Reading --------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def reading_rows(connection: sqlite3.Connection, path: Path, seconds: float = SECONDS) -> Iterator[None]:
    """Converts errors while rows of the database at `path` are read to InputError, and raises InputError if reading
    takes longer than `seconds`. Signals are handled while SQLite works. Do not nest it."""
    raised: list[BaseException] = []
    end = time.monotonic() + seconds
    watch = _watching(end, raised)
    next(watch)
    connection.set_progress_handler(watch.__next__, _STEPS)
    try:
        yield
    except sqlite3.Error as error:
        if raised:
            raise raised[0] from None
        if time.monotonic() > end:
            raise InputError(f"{path} took longer than {seconds:.0f} s to read; {_AGAIN}.") from error
        raise InputError(f"{path} is damaged ({_plain(error)}); {_AGAIN}.") from error
    finally:
        with contextlib.suppress(sqlite3.Error):
            connection.set_progress_handler(None, 0)


def _watching(end: float, raised: list[BaseException]) -> Generator[int, None, None]:
    """Yields 0 while SQLite may continue, then 1.

    This is a generator because SQLite drops exceptions of a plain function. The handler of a signal raises in the first
    Python code that runs, which is here, inside the block that stores the exception.
    """
    try:
        yield 0
        while time.monotonic() < end:
            yield 0
    except GeneratorExit:
        raise
    except BaseException as error:
        raised.append(error)
    while True:
        yield 1


def read(
    connection: sqlite3.Connection,
    path: Path,
    table: str,
    columns: dict[str, CellType],
    rest: str = "",
    given: Row = (),
) -> list[Row]:
    """The `columns` of the rows of a table, each cell checked against its kind.

    rest   SQL after the table name in the FROM clause
    given  values for the question marks in `rest`

    Raises InputError that names the table, the row and the column if a cell is invalid.
    """
    kinds = tuple(columns.values())
    usual = tuple(kind.usual for kind in kinds)
    with reading_rows(connection, path):
        rows: list[Row] = connection.execute(f"SELECT {', '.join(columns)} FROM {table} {rest}", given).fetchall()
    for number, row in enumerate(rows, 1):
        if tuple(map(type, row)) == usual and all(map(_is_of_type, kinds, row)):
            continue
        for name, kind, cell in zip(columns, kinds, row, strict=True):
            if not (cell is None and kind.optional) and not (type(cell) is kind.usual and _is_of_type(kind, cell)):
                where = f"{path}: {name} of row {number} of the table {table}"
                raise InputError(f"{where} is {_cell_text(cell)}, not {kind.words}; {_AGAIN}.")
    return rows


class CellType:
    """The required type of a cell, its description in words, and optionally a test of the value."""

    def __init__(
        self, usual: type, words: str, fits: Callable[[Any], bool] | None = None, optional: bool = False
    ) -> None:
        self.usual, self.words, self.fits, self.optional = usual, words, fits, optional

    @property
    def or_null(self) -> CellType:
        return CellType(self.usual, f"{self.words} or nothing", self.fits, True)


TEXT = CellType(str, "a text")
NAME = CellType(str, "a text of 1 to 1000 characters", lambda text: 0 < len(text) <= 1000)
NUMBER = CellType(float, "a finite number", lambda value: abs(value) < 1e12)
COUNT = CellType(int, "a whole number", lambda value: abs(value) < 1 << 31)
FLAG = CellType(int, "0 or 1", lambda value: value in (0, 1))
BLOB = CellType(bytes, "bytes")


def _is_of_type(kind: CellType, cell: Any) -> bool:
    return kind.fits is None or cell is None or kind.fits(cell)


def _cell_text(cell: Any) -> str:
    if cell is None:
        return "empty"
    if isinstance(cell, bytes):
        return f"{len(cell)} bytes"
    if isinstance(cell, float) and not math.isfinite(cell):
        return "infinite"
    return f"the text “{_plain(cell)}”" if isinstance(cell, str) else _plain(cell)
