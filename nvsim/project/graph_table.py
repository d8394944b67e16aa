"""The navigation graph in the database: viewpoints, edges and evidence as rows, in graph order."""

from __future__ import annotations

import sqlite3

from nvsim.graph.store import decode_evidence, encode_evidence
from nvsim.graph.types import Edge, NavGraph, Viewpoint


def read(connection: sqlite3.Connection) -> NavGraph | None:
    """The stored graph, or None."""
    row = connection.execute("SELECT value FROM meta WHERE key = 'scan'").fetchone()
    if row is None:
        return None
    # A project that was opened for reading only keeps the columns of the version that wrote it.
    marks = ", reviewed, locked" if int(connection.execute("PRAGMA user_version").fetchone()[0]) >= 2 else ""
    viewpoints = {
        id: Viewpoint(id, (x, y, z), height, submap, bool(included), origin, *map(bool, noted))
        for id, x, y, z, height, submap, included, origin, *noted in connection.execute(
            f"SELECT id, x, y, z, height, submap, included, origin{marks} FROM viewpoints ORDER BY seq"
        )
    }
    edges = {
        (a, b): Edge(a, b, origin, *map(bool, noted))
        for a, b, origin, *noted in connection.execute(f"SELECT a, b, origin{marks} FROM edges ORDER BY seq")
    }
    ignored = dict(connection.execute("SELECT key, reason FROM ignored ORDER BY seq")) if marks else {}
    evidence = {
        e.key: e
        for (blob,) in connection.execute("SELECT data FROM evidence ORDER BY seq")
        for e in (decode_evidence(blob),)
    }
    return NavGraph(str(row[0]), viewpoints, edges, evidence, ignored)


def write(connection: sqlite3.Connection, graph: NavGraph) -> None:
    """Replaces the stored graph; to be called inside a transaction."""
    for table in ("viewpoints", "edges", "evidence", "ignored"):
        connection.execute(f"DELETE FROM {table}")
    connection.execute("INSERT OR REPLACE INTO meta VALUES ('scan', ?)", (graph.scan,))
    connection.executemany(
        "INSERT INTO viewpoints (seq, id, x, y, z, height, submap, included, origin, reviewed, locked) "
        "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [
            (
                *(i, v.id, *map(float, v.position), float(v.height), int(v.submap), int(v.included), v.origin),
                *(int(v.reviewed), int(v.locked)),
            )
            for i, v in enumerate(graph.viewpoints.values())
        ],
    )
    connection.executemany(
        "INSERT INTO edges (seq, a, b, origin, reviewed, locked) VALUES (?, ?, ?, ?, ?, ?)",
        [(i, e.a, e.b, e.origin, int(e.reviewed), int(e.locked)) for i, e in enumerate(graph.edges.values())],
    )
    connection.executemany(
        "INSERT INTO evidence VALUES (?, ?, ?, ?)",
        [(i, e.viewpoint, e.direction, encode_evidence(e)) for i, e in enumerate(graph.evidence.values())],
    )
    connection.executemany(
        "INSERT INTO ignored VALUES (?, ?, ?)",
        [(i, key, reason) for i, (key, reason) in enumerate(graph.ignored.items())],
    )
