"""Projects that an older version wrote."""

from __future__ import annotations

import sqlite3
from pathlib import Path

from nvsim.graph.edits import ignore_finding, mark_reviewed, set_locked
from nvsim.graph.store import same_graph
from nvsim.project import database
from nvsim.project.project import Project


def first_version(folder: Path) -> Path:
    """A project as version 1 left it: a graph without reviewed, locked and ignored."""
    folder.mkdir()
    connection = sqlite3.connect(folder / "project.db")
    connection.executescript(f"BEGIN; {database._SCHEMA} PRAGMA user_version=1; COMMIT;")
    connection.execute("INSERT INTO meta VALUES ('scan', 'old')")
    connection.executemany(
        "INSERT INTO viewpoints VALUES (?, ?, ?, 0, 1.5, 1.5, 0, 1, 'step')", [(0, "a", 0.0), (1, "b", 2.5)]
    )
    connection.execute("INSERT INTO edges VALUES (0, 'a', 'b', 'step')")
    connection.commit()
    connection.close()
    return folder


def test_an_older_project_is_read_as_it_is_and_brought_up_to_date_when_written(tmp_path: Path) -> None:
    path = first_version(tmp_path / "p.nvsim")
    with Project.open(path) as project:
        old = project.need_graph()
        assert list(old.edges) == [("a", "b")] and not old.viewpoints["a"].reviewed
    with Project.open(path, writable=True) as project:
        assert same_graph(project.need_graph(), old)
        graph = set_locked(mark_reviewed(old, ["a"], [("a", "b")]), edges=[("a", "b")])
        graph = ignore_finding(graph, "long a b", "a ramp")
        project.set_graph(graph)
    with Project.open(path) as project:
        assert same_graph(project.need_graph(), graph)
        assert project.need_graph().ignored == {"long a b": "a ramp"}
