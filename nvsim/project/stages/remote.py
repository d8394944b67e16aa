"""Work of a stage on other machines: a project that they can read, and frames in pieces of work.

SQLite's write-ahead log needs memory that all processes share, so other machines cannot open the database itself.

The workers read the project and its images from shared storage. They send back files, which this process writes.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from nvsim.cluster.piece import Executor, SentFile, StorageNotShared, WorkCall, WorkItem, WorkResult
from nvsim.cluster.storage import StorageProbe
from nvsim.errors import InputError
from nvsim.events import Listener, Log, Warning, Worker
from nvsim.files.databases import Snapshot
from nvsim.project.layout import Layout
from nvsim.project.project import Project
from nvsim.project.stages.training_pool import BASE_BYTES
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


_POINT_BYTES = 200  # per point of a point cloud: the point, a search tree, and its neighbors
_FRAME_BYTES = 200 << 20  # cached data of frames


def do_frames_remote(
    executor: Executor,
    project: Project,
    stage: str,
    frames: Sequence[int],
    order: Callable[[list[int], int], WorkCall],
    receive: Callable[[SentFile], None],
    listen: Listener,
) -> None:
    """Distributes `frames` to the workers, and passes each returned file to `receive`.

    `order` returns the work for some frames with a number of threads; the last argument of this work is a StorageProbe.
    If the machines cannot read the project, no frame is processed and the user is told. Raises InputError if a worker
    fails, or storage that must be shared is not.
    """
    if not frames:
        return
    if executor.storage == "sent":
        _say_alone("There is no shared storage", stage, listen)
        return
    machines = executor.machines
    threads = min(2, max(machines, default=1))
    count = max(1, min(len(frames), sum(cores // threads for cores in machines)))
    chunks = [list(frames[i * len(frames) // count : (i + 1) * len(frames) // count]) for i in range(count)]
    cloud = project.scan() if stage == "floors" else None
    needed = BASE_BYTES + _FRAME_BYTES + _POINT_BYTES * (0 if cloud is None else len(cloud.points))
    pieces = [WorkItem(stage, c[0], f"frames {c[0]} to {c[-1]}", threads, needed) for c in chunks]
    of_piece = dict(zip([p.part for p in pieces], chunks, strict=True))
    probe = StorageProbe.create_in(project.layout.checkpoints, project.need_capture().frames[0].image_path)

    def begin(piece: WorkItem) -> WorkCall:
        made = order(of_piece[piece.part], threads)
        return WorkCall(made.function, (*made.arguments, probe))

    try:
        with closing(executor.run(pieces, begin)) as messages:
            for _, message in messages:
                if isinstance(message, StorageNotShared):
                    if executor.storage == "shared":
                        raise InputError(f"{message.reason}; share it with all machines under the same path.")
                    _say_alone(message.reason, stage, listen)
                    return
                if isinstance(message, SentFile):
                    message.check()
                    receive(message)
                elif isinstance(message, Log | Warning | Worker):
                    listen(message)
                else:
                    assert not isinstance(message, WorkResult) or message.value is None
    finally:
        probe.remove()


def _say_alone(why: str, stage: str, listen: Listener) -> None:
    listen(Log(f"{why}: this machine runs this stage alone.", stage))
