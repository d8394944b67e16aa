"""SQLite files that anyone may have written: opened only when they hold exactly our tables, read within limits, and
each cell taken only as what it must be.

A file may hold a view or a virtual table in place of a table, which runs for ever when it is read, a trigger that acts
when it is written, damaged pages, or texts where numbers belong. All of it leaves here as one sentence.
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

SECONDS = 60.0  # that one reading may take; the graph of a large building takes some
_STEPS = 20_000  # of SQLite's machine between two looks at the clock and at signals
_LIMITS = {
    sqlite3.SQLITE_LIMIT_LENGTH: 512 << 20,  # bytes of a cell
    sqlite3.SQLITE_LIMIT_COLUMN: 64,
    sqlite3.SQLITE_LIMIT_COMPOUND_SELECT: 4,
    sqlite3.SQLITE_LIMIT_EXPR_DEPTH: 50,
    sqlite3.SQLITE_LIMIT_TRIGGER_DEPTH: 1,
    sqlite3.SQLITE_LIMIT_ATTACHED: 1,  # closing the holes of a file needs one
}

Row = tuple[Any, ...]


def harden(connection: sqlite3.Connection) -> None:
    """Makes SQLite run nothing that the file defines and check every page that it reads. Raises sqlite3.Error."""
    for limit, value in _LIMITS.items():
        connection.setlimit(limit, value)
    connection.execute("PRAGMA trusted_schema=OFF")
    connection.execute("PRAGMA cell_size_check=ON")
    connection.execute("PRAGMA mmap_size=0")


def check_schema(connection: sqlite3.Connection, path: Path, script: str) -> None:
    """Raises InputError unless the database holds the tables that `script` makes, each as it makes it, and nothing
    else."""
    with reading_rows(connection, path):
        found = {(type, name): _words(sql) for type, name, sql in connection.execute(_SCHEMA_OF)}
    wanted = _made_by(script)
    for (type, name), sql in found.items():
        if (type, name) not in wanted:
            raise InputError(f"{path} holds the {_plain(type)} {_plain(name)}, which no NVSim makes; {_AGAIN}.")
        if sql != wanted[type, name]:
            raise InputError(f"{path} has another table {_plain(name)} than NVSim makes; {_AGAIN}.")
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
    """A name from a file, for a sentence."""
    shown = "".join(c if c.isprintable() else "?" for c in str(text))
    return shown if len(shown) <= 40 else shown[:37] + "..."


# Reading --------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def reading_rows(connection: sqlite3.Connection, path: Path, seconds: float = SECONDS) -> Iterator[None]:
    """What goes wrong while rows are read from the database at `path` becomes InputError, and so does a reading that
    takes longer than `seconds`. A signal is answered while SQLite works. Not to be nested."""
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
    """Gives 0 while SQLite may go on. A generator, since SQLite drops what a plain function raises, and a signal's
    handler raises where Python code begins to run: in here, inside the block that keeps it."""
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
    connection: sqlite3.Connection, path: Path, table: str, columns: dict[str, Kind], rest: str = "", given: Row = ()
) -> list[Row]:
    """The `columns` of a table's rows, each cell of its kind; `rest` is what follows FROM, with `given` for its
    question marks. Raises InputError that names the table, the row and the column."""
    kinds = tuple(columns.values())
    usual = tuple(kind.usual for kind in kinds)
    with reading_rows(connection, path):
        rows: list[Row] = connection.execute(f"SELECT {', '.join(columns)} FROM {table} {rest}", given).fetchall()
    for number, row in enumerate(rows, 1):
        if tuple(map(type, row)) == usual and all(map(_fits, kinds, row)):
            continue
        for name, kind, cell in zip(columns, kinds, row, strict=True):
            if not (cell is None and kind.optional) and not (type(cell) is kind.usual and _fits(kind, cell)):
                where = f"{path}: {name} of row {number} of the table {table}"
                raise InputError(f"{where} is {_shown(cell)}, not {kind.words}; {_AGAIN}.")
    return rows


class Kind:
    """What a cell must be: its type in Python, in words, and more where the type is not all."""

    def __init__(
        self, usual: type, words: str, fits: Callable[[Any], bool] | None = None, optional: bool = False
    ) -> None:
        self.usual, self.words, self.fits, self.optional = usual, words, fits, optional

    @property
    def or_null(self) -> Kind:
        return Kind(self.usual, f"{self.words} or nothing", self.fits, True)


TEXT = Kind(str, "a text")
NAME = Kind(str, "a text of 1 to 1000 characters", lambda text: 0 < len(text) <= 1000)
NUMBER = Kind(float, "a finite number", lambda value: abs(value) < 1e12)
COUNT = Kind(int, "a whole number", lambda value: abs(value) < 1 << 31)
FLAG = Kind(int, "0 or 1", lambda value: value in (0, 1))
BLOB = Kind(bytes, "bytes")


def _fits(kind: Kind, cell: Any) -> bool:
    return kind.fits is None or cell is None or kind.fits(cell)


def _shown(cell: Any) -> str:
    if cell is None:
        return "empty"
    if isinstance(cell, bytes):
        return f"{len(cell)} bytes"
    if isinstance(cell, float) and not math.isfinite(cell):
        return "infinite"
    return f"the text “{_plain(cell)}”" if isinstance(cell, str) else _plain(cell)
