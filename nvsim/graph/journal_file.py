"""The SQLite file of a journal: the first graph, one row per step, and a few marks. If the file exceeds a limit by a
quarter, the oldest steps become part of the first graph."""

from __future__ import annotations

import json
import sqlite3
import struct
import time
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim.errors import InputError
from nvsim.files.atomic import make_folder
from nvsim.files.databases import check_files, make_file, open_to_read, sqlite_error
from nvsim.files.tables import BLOB, COUNT, NUMBER, TEXT, check_schema, disable_code, read, reading_rows
from nvsim.graph.difference import GraphDelta, apply_deltas
from nvsim.graph.history import Step
from nvsim.graph.journal_rows import decode_delta, decode_selection
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.graph.types import NavGraph

_VERSION = 2  # version 2 stores the order of elements in a step
_SCHEMA = """
CREATE TABLE marks (name TEXT PRIMARY KEY, value NOT NULL);
CREATE TABLE base (graph BLOB NOT NULL, at REAL NOT NULL);
CREATE TABLE steps (number INTEGER PRIMARY KEY, text TEXT NOT NULL, at REAL NOT NULL, edit INTEGER NOT NULL,
    merge TEXT, operation TEXT, selection BLOB NOT NULL, delta BLOB NOT NULL);
"""
_STEP = {
    "number": COUNT,
    "text": TEXT,
    "at": NUMBER,
    "edit": COUNT,
    "merge": TEXT.or_null,
    "operation": TEXT.or_null,
    "selection": BLOB,
    "delta": BLOB,
}


_EDIT, _OUTSIDE = 1, 2  # values of the column "edit"; 0 is a step that only selects


def _kind(step: Step) -> int:
    return _OUTSIDE if step.outside else int(step.edit)


class NewerJournal(InputError):
    """A newer version of NVSim wrote the file."""


@dataclass(frozen=True)
class JournalContent:
    """The content of a journal.

    base    the first graph
    begun   when the first graph was opened, seconds since 1970
    steps   the steps from 1 on with their deltas
    index   number of the current step
    clean   number of the saved step, -1 for none
    saved   digest of the content of the graph file
    """

    base: NavGraph
    begun: float
    steps: list[tuple[Step, GraphDelta]]
    index: int
    clean: int
    saved: str


class JournalFile:
    """Reads and writes the SQLite file. Every method raises InputError if the file cannot be read or written."""

    def __init__(self, path: Path, read_only: bool = False) -> None:
        """Raises InputError if `path`, or a file that SQLite keeps beside it, is not a regular file."""
        self.path = path
        self._read_only = read_only
        self._connection: sqlite3.Connection | None = None
        check_files(path)
        self.exists = path.is_file() and path.stat().st_size > 0

    def create(self, base: NavGraph, saved: str) -> None:
        """Create the file with its first graph. `saved` is the digest of the graph file. Raises InputError if the file
        cannot be written."""
        make_folder(self.path.parent)
        connection = self._open()
        try:
            connection.executescript(f"BEGIN; {_SCHEMA} PRAGMA user_version={_VERSION};")
            connection.execute("INSERT INTO base VALUES (?, ?)", (encode_graph(base), time.time()))
            marks = [("index", 0), ("clean", 0), ("saved", saved)]
            connection.executemany("INSERT INTO marks VALUES (?, ?)", marks)
            connection.execute("COMMIT")
        except sqlite3.Error as error:
            self._undo(connection)
            raise sqlite_error(self.path, error) from error
        self.exists = True

    def write(
        self, cut: int | None, rows: Sequence[tuple[int, Step, bytes, bytes | None]], marks: dict[str, Any]
    ) -> None:
        """Write in one transaction: delete the steps from `cut` on, put rows (number, step, selection, delta), and set
        marks. If the delta of a row is None, only the text and the selection of the stored step change. Raises
        InputError if the file cannot be written."""
        connection = self._open()
        try:
            connection.execute("BEGIN IMMEDIATE")
            connection.execute(f"PRAGMA user_version={_VERSION}")
            if cut is not None:
                connection.execute("DELETE FROM steps WHERE number >= ?", (cut,))
            for number, step, selection, delta in rows:
                if delta is None:
                    values = (step.text, selection, number)
                    connection.execute("UPDATE steps SET text = ?, selection = ? WHERE number = ?", values)
                    continue
                operation = None if step.operation is None else json.dumps(step.operation)
                connection.execute(
                    "INSERT INTO steps VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                    (number, step.text, step.when, _kind(step), step.merge, operation, selection, delta),
                )
            connection.executemany("INSERT OR REPLACE INTO marks VALUES (?, ?)", list(marks.items()))
            connection.execute("COMMIT")
        except sqlite3.Error as error:
            self._undo(connection)
            raise sqlite_error(self.path, error) from error

    def read(self) -> JournalContent | None:
        """Return the content of the journal; None if nothing is written. Raises sqlite3.DatabaseError, ValueError,
        KeyError, TypeError or IndexError if the file is damaged, and Newer if a later version wrote it."""
        if not self.exists:
            return None
        connection = self._open()
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        if version == 0:  # the process was killed before the first transaction ended
            self.exists = False
            return None
        if version > _VERSION:
            raise NewerJournal(
                f"The history of edits {self.path} was written by a newer NVSim; update NVSim to continue it."
            )
        check_schema(connection, self.path, _SCHEMA)
        bases = read(connection, self.path, "base", {"graph": BLOB, "at": NUMBER}, "LIMIT 1")
        if not bases:
            raise ValueError("its first graph is missing")
        blob, begun = bases[0]
        with reading_rows(connection, self.path):
            marks = dict(connection.execute("SELECT name, value FROM marks LIMIT 100"))
        steps: list[tuple[Step, GraphDelta]] = []
        try:
            for number, text, at, edit, merge, operation, selection, delta in read(
                connection, self.path, "steps", _STEP, "ORDER BY number"
            ):
                if number != len(steps) + 1:
                    raise ValueError(f"step {len(steps) + 1} is missing")
                found = None if operation is None else json.loads(operation)
                if found is not None and not isinstance(found, dict):
                    raise ValueError(f"step {number} has an invalid edit")
                step = Step(text, decode_selection(selection), at, edit == _EDIT, merge, found, edit == _OUTSIDE)
                steps.append((step, decode_delta(delta)))
        except (zlib.error, struct.error, RecursionError, OverflowError) as error:
            raise ValueError(str(error)) from error
        index, clean = int(marks["index"]), int(marks["clean"])
        if not (0 <= index <= len(steps) and -1 <= clean <= len(steps)):
            raise ValueError("its current step is missing")
        return JournalContent(decode_graph(blob), float(begun), steps, index, clean, str(marks["saved"]))

    def trim(self, steps: int, size: int) -> int:
        """Fold the oldest steps into the first graph, see `trim`. Returns how many.

        Raises InputError if the file cannot be written.
        """
        if not self.exists:
            return 0
        connection = self._open()
        if int(connection.execute("PRAGMA user_version").fetchone()[0]) not in range(1, _VERSION + 1):
            return 0
        check_schema(connection, self.path, _SCHEMA)
        try:
            return trim(connection, steps, size)
        except sqlite3.OperationalError as error:
            self._undo(connection)
            raise sqlite_error(self.path, error) from error
        finally:
            self._undo(connection)

    def close(self) -> None:
        """Close the file. The next use opens it again."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def remove(self) -> None:
        """Delete the file and the files that SQLite keeps beside it."""
        self.close()
        for suffix in ("", "-wal", "-shm"):
            self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)
        self.exists = False

    def set_aside(self) -> Path:
        """Rename the file, so that a new one can be created. Returns its new path."""
        self.close()
        aside = self.path.with_name(self.path.name + ".damaged")
        self.path.replace(aside)
        self.remove()
        return aside

    def _open(self) -> sqlite3.Connection:
        if self._connection is None:
            if self._read_only:
                self._connection = open_to_read(self.path)
                return self._connection
            check_files(self.path)
            make_file(self.path)
            try:
                self._connection = sqlite3.connect(self.path, timeout=10, isolation_level=None, check_same_thread=False)
                disable_code(self._connection)
                self._connection.execute("PRAGMA journal_mode=WAL")
                self._connection.execute("PRAGMA synchronous=FULL")
            except sqlite3.OperationalError as error:
                self.close()
                raise sqlite_error(self.path, error) from error
        return self._connection

    @staticmethod
    def _undo(connection: sqlite3.Connection) -> None:
        if connection.in_transaction:
            connection.execute("ROLLBACK")


_SLACK = 1.25
_HOLES = 0.5  # share of free pages above which the file is rewritten
_SMALL = 1 << 20  # free bytes that are always accepted


def trim(connection: sqlite3.Connection, steps: int, size: int) -> int:
    """Keep the last `steps` steps, and at most `size` bytes of them, but at least one. The current step is always kept.
    Returns the number of folded steps.

    If the saved graph is older than the kept steps, no step is marked as saved. Raises sqlite3.Error, or the errors of
    decoding damaged rows; nothing is changed then.
    """
    connection.execute("BEGIN IMMEDIATE")
    sizes = [
        row[0] for row in connection.execute("SELECT length(delta) + length(selection) FROM steps ORDER BY number")
    ]
    count = _to_fold(sizes, steps, size)
    marks = dict(connection.execute("SELECT name, value FROM marks WHERE name IN ('index', 'clean')"))
    index, clean = int(marks["index"]), int(marks["clean"])
    count = min(count, index - 1)  # the current step can still be undone
    if count <= 0:
        connection.execute("ROLLBACK")
        return 0
    deltas, last = [], 0.0
    rows = connection.execute("SELECT number, at, delta FROM steps WHERE number <= ? ORDER BY number", (count,))
    for expected, (number, at, delta) in enumerate(rows, 1):
        if number != expected:
            raise ValueError(f"step {expected} is missing")
        deltas.append(decode_delta(delta))
        last = at
    base = apply_deltas(decode_graph(connection.execute("SELECT graph FROM base").fetchone()[0]), deltas)
    connection.execute("UPDATE base SET graph = ?, at = ?", (encode_graph(base), last))
    connection.execute("DELETE FROM steps WHERE number <= ?", (count,))
    # Renumber through negative numbers, so that two rows never share a number.
    connection.execute("UPDATE steps SET number = -number")
    connection.execute("UPDATE steps SET number = -number - ?", (count,))
    connection.executemany(
        "UPDATE marks SET value = ? WHERE name = ?",
        [(index - count, "index"), (clean - count if clean >= count else -1, "clean")],
    )
    connection.execute("COMMIT")
    _close_holes(connection)
    return count


def _to_fold(sizes: list[int], steps: int, size: int) -> int:
    """Return how many of the oldest steps exceed the limits."""
    if len(sizes) <= _SLACK * steps and sum(sizes) <= _SLACK * size:
        return 0
    kept = used = 0
    for each in reversed(sizes):
        if kept == steps or (kept and used + each > size):
            break
        kept, used = kept + 1, used + each
    return len(sizes) - kept


def _close_holes(connection: sqlite3.Connection) -> None:
    pages, free, page = (
        int(connection.execute(f"PRAGMA {name}").fetchone()[0])
        for name in ("page_count", "freelist_count", "page_size")
    )
    if free > _HOLES * pages and free * page > _SMALL:
        connection.execute("VACUUM")
