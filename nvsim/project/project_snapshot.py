"""A project that another machine can read: its files on shared storage, and its database rows in memory.

SQLite's write-ahead log needs memory that all processes share, so other machines cannot open the database itself.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from nvsim.files.databases import Snapshot
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim.project.state import database

_TABLES = ("meta", "stage_parts", "stage_files", "unfinished", "submap_frames")


@dataclass(frozen=True)
class ProjectSnapshot:
    """The data that another machine needs to read a project.

    root    path of the project, equal on all machines
    rows    table -> its rows, for each table that stages read
    making  see `Project.making`
    """

    root: Path
    rows: dict[str, list[tuple[object, ...]]]
    making: dict[str, str]

    @staticmethod
    def of(project: Project, making: Mapping[str, str] | None = None) -> ProjectSnapshot:
        """The present state of a project. Raises InputError if the database is damaged."""
        c = project.connection
        rows = {table: [tuple(row) for row in c.execute(f"SELECT * FROM {table}")] for table in _TABLES}
        return ProjectSnapshot(project.root, rows, dict(making or {}))

    def open(self) -> Project:
        """Opens the project for reading; nothing can be committed."""
        memory = sqlite3.connect(":memory:", isolation_level=None, check_same_thread=False, factory=Snapshot)
        layout = Layout(self.root)
        memory.path = layout.database
        database.update(memory, layout.database, 0)
        for table, rows in self.rows.items():
            if rows:
                memory.executemany(f"INSERT INTO {table} VALUES ({', '.join('?' * len(rows[0]))})", rows)
        memory.execute("PRAGMA query_only=1")
        return Project(layout, memory, None).making(self.making)
