"""Stores the navigation graph in the database: viewpoints, edges and evidence as rows, in the order of the graph."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files import tables
from nvsim.files.tables import BLOB, COUNT, FLAG, NAME, NUMBER, TEXT
from nvsim.graph.store import decode_evidence, encode_evidence
from nvsim.graph.types import Edge, NavGraph, Viewpoint

_NOTED = {"reviewed": FLAG, "locked": FLAG}
_VIEWPOINT = {
    "id": NAME,
    "x": NUMBER,
    "y": NUMBER,
    "z": NUMBER,
    "height": NUMBER,
    "submap": COUNT,
    "included": FLAG,
    "origin": TEXT,
}
_MEASURED = {"photographed": NUMBER.or_null}


def read(connection: sqlite3.Connection, path: Path) -> NavGraph | None:
    """The stored graph, or None if there is none. Raises InputError if the database at `path` is damaged."""
    scan = tables.read(connection, path, "meta", {"value": TEXT}, "WHERE key = 'scan'")
    if not scan:
        return None
    if "/" in scan[0][0] or not scan[0][0].isprintable():
        raise InputError(f"{path}: the name of the scan is not a file name; build the graph again with `nvsim map`.")
    viewpoints = {
        id: Viewpoint(id, (x, y, z), height, submap, bool(included), origin, *map(bool, rest[:2]), *rest[2:])
        for id, x, y, z, height, submap, included, origin, *rest in tables.read(
            connection, path, "viewpoints", _VIEWPOINT | _NOTED | _MEASURED, "ORDER BY seq"
        )
    }
    edges = {
        (a, b): Edge(a, b, origin, *map(bool, marks))
        for a, b, origin, *marks in tables.read(
            connection, path, "edges", {"a": NAME, "b": NAME, "origin": TEXT} | _NOTED, "ORDER BY seq"
        )
    }
    for number, (a, b) in enumerate(edges, 1):
        if not (a < b and a in viewpoints and b in viewpoints):
            raise InputError(f"{path}: row {number} of the table edges joins no two viewpoints; build the graph again.")
    ignored = tables.read(connection, path, "ignored", {"key": NAME, "reason": TEXT}, "ORDER BY seq")
    evidence = {}
    for number, (blob,) in enumerate(tables.read(connection, path, "evidence", {"data": BLOB}, "ORDER BY seq"), 1):
        try:
            found = decode_evidence(blob)
        except InputError as error:
            raise InputError(f"{path}, row {number} of the table evidence: {error}") from error
        evidence[found.key] = found
    return NavGraph(scan[0][0], viewpoints, edges, evidence, dict(ignored))


def write(connection: sqlite3.Connection, graph: NavGraph) -> None:
    """Replaces the stored graph. Call it inside a transaction."""
    for table in ("viewpoints", "edges", "evidence", "ignored"):
        connection.execute(f"DELETE FROM {table}")
    connection.execute("INSERT OR REPLACE INTO meta VALUES ('scan', ?)", (graph.scan,))
    connection.executemany(
        "INSERT INTO viewpoints (seq, id, x, y, z, height, submap, included, origin, reviewed, locked, "
        "photographed) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        [
            (
                *(i, v.id, *map(float, v.position), float(v.height), int(v.submap), int(v.included), v.origin),
                *(int(v.reviewed), int(v.locked)),
                None if v.photographed is None else float(v.photographed),
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
