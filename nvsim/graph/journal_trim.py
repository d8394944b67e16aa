"""Limit the length of a journal: the oldest steps become part of its first graph.

This is one transaction, so that a process that dies meanwhile leaves the journal unchanged. It runs only if the journal
exceeds a limit by a quarter, because it writes the first graph again.
"""

from __future__ import annotations

import sqlite3

from nvsim.graph.delta import folded
from nvsim.graph.journal_rows import decode_delta
from nvsim.graph.store import decode_graph, encode_graph

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
    base = folded(decode_graph(connection.execute("SELECT graph FROM base").fetchone()[0]), deltas)
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
