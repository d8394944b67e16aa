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
    viewpoints = {
        id: Viewpoint(id, (x, y, z), height, submap, bool(included), origin)
        for id, x, y, z, height, submap, included, origin in connection.execute(
            "SELECT id, x, y, z, height, submap, included, origin FROM viewpoints ORDER BY seq"
        )
    }
    edges = {
        (a, b): Edge(a, b, origin) for a, b, origin in connection.execute("SELECT a, b, origin FROM edges ORDER BY seq")
    }
    evidence = {
        e.key: e
        for (blob,) in connection.execute("SELECT data FROM evidence ORDER BY seq")
        for e in (decode_evidence(blob),)
    }
    return NavGraph(str(row[0]), viewpoints, edges, evidence)


def write(connection: sqlite3.Connection, graph: NavGraph) -> None:
    """Replaces the stored graph; to be called inside a transaction."""
    for table in ("viewpoints", "edges", "evidence"):
        connection.execute(f"DELETE FROM {table}")
    connection.execute("INSERT OR REPLACE INTO meta VALUES ('scan', ?)", (graph.scan,))
    connection.executemany(
        "INSERT INTO viewpoints VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [
            (i, v.id, *map(float, v.position), float(v.height), int(v.submap), int(v.included), v.origin)
            for i, v in enumerate(graph.viewpoints.values())
        ],
    )
    connection.executemany(
        "INSERT INTO edges VALUES (?, ?, ?, ?)", [(i, e.a, e.b, e.origin) for i, e in enumerate(graph.edges.values())]
    )
    connection.executemany(
        "INSERT INTO evidence VALUES (?, ?, ?, ?)",
        [(i, e.viewpoint, e.direction, encode_evidence(e)) for i, e in enumerate(graph.evidence.values())],
    )
