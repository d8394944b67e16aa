"""A project on disk: what it holds, read and committed as values."""

from __future__ import annotations

import json
import os
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.atomic import make_folder
from nvsim.errors import InputError
from nvsim.graph.types import NavGraph
from nvsim.locking import WriterLock
from nvsim.project import database, graph_table
from nvsim.project.corrections import mask_in_use
from nvsim.project.jobs import JobRecord, read_jobs
from nvsim.project.layout import Layout
from nvsim.submaps.types import Submap

if TYPE_CHECKING:
    from nvsim.capture.types import Capture
    from nvsim.geometry.floor_surface import FloorSurface
    from nvsim.occupancy.types import OccupancyMap
    from nvsim.perception.support import FloorSupport
    from nvsim.splats.scene import SceneModel


class Project:
    """An open project. Readers may be many; `writable=True` takes the one writer's lock."""

    def __init__(self, layout: Layout, connection: sqlite3.Connection, lock: WriterLock | None) -> None:
        self.layout = layout
        self.connection = connection
        self._lock = lock
        self._capture: tuple[int, Capture] | None = None
        self._fresh = False

    # Opening ----------------------------------------------------------------------------------------------------

    @staticmethod
    def open(path: Path, *, writable: bool = False) -> Project:
        """An existing project. Raises InputError when `path` is none, is newer, or is being written by another."""
        layout = Layout(Path(path).expanduser().absolute())
        if not layout.root.exists():
            raise InputError(f"{layout.root} does not exist; `nvsim import CAPTURE --project {path}` makes a project.")
        lock = None
        if writable and layout.database.is_file():
            lock = WriterLock(layout.lock)
        try:
            return Project(layout, database.connect(layout.database, read_only=not writable), lock)
        except BaseException:
            if lock is not None:
                lock.release()
            raise

    @staticmethod
    def create_or_open(path: Path) -> Project:
        """A writable project at `path`, made where there is none. Refuses a folder that holds something else."""
        layout = Layout(Path(path).expanduser().absolute())
        if layout.database.is_file():
            return Project.open(layout.root, writable=True)
        ours = {layout.lock.name, layout.built_in_capture.name, layout.ground_truth.name, layout.logs.name}
        if layout.root.is_dir():
            foreign = sorted(p.name for p in layout.root.iterdir() if p.name not in ours)
            if foreign:
                raise InputError(
                    f"{layout.root} holds other files ({', '.join(foreign[:3])}); choose a new folder for the project."
                )
        make_folder(layout.root)
        lock = WriterLock(layout.lock)
        try:
            project = Project(layout, database.create(layout.database), lock)
            project._fresh = True
            return project
        except BaseException:
            lock.release()
            raise

    def discard_if_new(self) -> None:
        """Takes back a project that was made a moment ago and in which no stage began: a refused import leaves no
        trace. Other files in its folder stay."""
        if not self._fresh or self.connection.execute("SELECT 1 FROM stages").fetchone():
            return
        self.close()
        for name in (self.layout.database.name, *(f"{self.layout.database.name}-{s}" for s in ("wal", "shm"))):
            (self.layout.root / name).unlink(missing_ok=True)
        self.layout.lock.unlink(missing_ok=True)
        if not any(self.layout.root.iterdir()):
            self.layout.root.rmdir()

    def close(self) -> None:
        self.connection.close()
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Project:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing. Raises InputError when the disk refuses."""
        try:
            self.connection.execute("BEGIN IMMEDIATE")
            try:
                yield self.connection
            except BaseException:
                self.connection.execute("ROLLBACK")
                raise
            self.connection.execute("COMMIT")
        except sqlite3.Error as error:
            raise database.explain(self.layout.database, error) from error

    # Reading ----------------------------------------------------------------------------------------------------

    def revision(self) -> int:
        """A number that changes whenever another connection commits something."""
        return int(self.connection.execute("PRAGMA data_version").fetchone()[0])

    def capture(self) -> Capture | None:
        """The imported capture, read once for as long as its file stays the same."""
        path = self.layout.imported / "capture.json"
        if not path.is_file():
            return None
        stamp = path.stat().st_mtime_ns
        if self._capture is None or self._capture[0] != stamp:
            from nvsim.capture.store import load_capture

            self._capture = (stamp, load_capture(self.layout.imported))
        return self._capture[1]

    def need_capture(self) -> Capture:
        """Raises InputError while nothing was imported."""
        capture = self.capture()
        if capture is None:
            raise InputError(f"{self.layout.root} has no capture yet; run `nvsim import CAPTURE --project` first.")
        return capture

    def submaps(self) -> tuple[Submap, ...]:
        rows = self.connection.execute(
            "SELECT submap, frame, core FROM submap_frames ORDER BY submap, frame"
        ).fetchall()
        if not rows:
            return ()
        positions = self.need_capture().positions
        result = []
        for index in sorted({row[0] for row in rows}):
            frames = tuple(f for s, f, _ in rows if s == index)
            core = tuple(f for s, f, c in rows if s == index and c)
            result.append(Submap(index, core, frames, positions[list(core)]))
        return tuple(result)

    def need_submaps(self) -> tuple[Submap, ...]:
        """Raises InputError while the trajectory was not cut."""
        submaps = self.submaps()
        if not submaps:
            raise InputError(f"{self.layout.root} has no submaps yet; run `nvsim submaps --project` first.")
        return submaps

    def graph(self) -> NavGraph | None:
        return graph_table.read(self.connection)

    def need_graph(self) -> NavGraph:
        """Raises InputError while no map was built."""
        graph = self.graph()
        if graph is None:
            raise InputError(f"{self.layout.root} has no navigation graph yet; run `nvsim map --project` first.")
        return graph

    def surface(self, submap: int) -> FloorSurface | None:
        path = self.layout.surface(submap)
        if not os.path.lexists(path):
            return None
        from nvsim.geometry.floor_surface import FloorSurface

        return FloorSurface.load(path)

    def support(self) -> FloorSupport | None:
        if not os.path.lexists(self.layout.support):
            return None
        from nvsim.perception.support import FloorSupport

        return FloorSupport.load(self.layout.support)

    def scene(self, memory_budget: int | None = None, live: bool = False) -> SceneModel | None:
        """The ensemble of the submap models that exist, with `memory_budget` bytes for those in memory (see
        SceneModel); None while there is none. With `live` the models in training stand in for those that are not
        finished."""
        submaps = self.submaps()
        places = [[self.layout.model(s.index), *([self.layout.live(s.index)] if live else [])] for s in submaps]
        found = [next((f for f in folders if (f / "model.json").is_file()), None) for folders in places]
        if not any(found):
            return None
        from nvsim.splats.scene import SceneModel

        return SceneModel(submaps, found, memory_budget)

    @property
    def may_have_occupancy(self) -> bool:
        """Whether there are the files that `occupancy` is made of."""
        return (self.layout.ground_truth / "map.yaml").is_file() or self.layout.support.is_file()

    def occupancy(self) -> OccupancyMap | None:
        """The map that a person may compare the graph with: the truth of the built-in building, else what the cloud
        and the floor masks say."""
        truth = self.layout.ground_truth / "map.yaml"
        if truth.is_file():
            from nvsim.occupancy.read import read_map

            return read_map(truth)
        capture, support = self.capture(), self.support()
        if capture is None or support is None:
            return None
        from nvsim.project.observed import observed_occupancy

        return observed_occupancy(self, capture, support)

    def jobs(self) -> list[JobRecord]:
        return read_jobs(self.connection)

    def results(self) -> dict[str, dict[str, Any]]:
        """Name of an evaluation -> its figures."""
        return {n: json.loads(f) for n, f in self.connection.execute("SELECT name, figures FROM results ORDER BY name")}

    def mask_path(self, frame: int) -> Path:
        """The floor mask of a frame that counts: a person's correction, else what the floors stage found."""
        return mask_in_use(self.layout, self.need_capture().frames[frame], frame)

    def meta(self, key: str) -> str | None:
        row = self.connection.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
        return None if row is None else str(row[0])

    # Committing -------------------------------------------------------------------------------------------------

    def set_meta(self, key: str, value: str) -> None:
        with self.transaction() as c:
            c.execute("INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, value))

    def set_submaps(self, submaps: tuple[Submap, ...]) -> None:
        with self.transaction() as c:
            c.execute("DELETE FROM submap_frames")
            for s in submaps:
                core = set(s.core)
                c.executemany(
                    "INSERT INTO submap_frames VALUES (?, ?, ?)", [(s.index, f, int(f in core)) for f in s.frames]
                )

    def set_graph(self, graph: NavGraph) -> None:
        with self.transaction() as c:
            graph_table.write(c, graph)

    def set_result(self, name: str, figures: dict[str, Any]) -> None:
        with self.transaction() as c:
            c.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?)", (name, time.time(), json.dumps(figures)))
