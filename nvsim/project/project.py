"""A project on disk: reads and commits its capture, submaps, graph, results and other data as values."""

from __future__ import annotations

import copy
import json
import os
import sqlite3
import time
from collections.abc import Hashable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from nvsim.errors import InputError
from nvsim.files import tables
from nvsim.files.atomic import make_folder
from nvsim.files.databases import Snapshot, sqlite_error, stamp
from nvsim.files.locking import WriterLock
from nvsim.files.opening import refuse_links_out
from nvsim.files.reading import reading
from nvsim.files.tables import NAME, NUMBER, TEXT, CellType, Row
from nvsim.graph.types import NavGraph
from nvsim.project.layout import ADDED, CLOUD, Layout
from nvsim.project.state import cuts, database, graph_table, results
from nvsim.project.state.results import StageResults
from nvsim.project.work import FROM_A_CUT, StageName, missing_result_error
from nvsim.submaps.split import Submap

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from nvsim.capture.types import Capture, Cloud
    from nvsim.geometry.floor_surface import Floor, FloorSurface
    from nvsim.perception.stacked_support import StackedSupport
    from nvsim.perception.support import FloorSupport
    from nvsim.splats.scene import SceneModel


Cut = Literal["submaps", "floors", "train"]
"""Selects a cut of the trajectory into submaps: the newest one, or that of the floors or models in use."""


class Project:
    """An open project. Any number of processes may read it; `writable=True` takes the lock of its only writer."""

    def __init__(self, layout: Layout, connection: sqlite3.Connection, lock: WriterLock | None) -> None:
        self.root = layout.root
        self._database = layout.database
        self.connection = connection
        self._lock = lock
        self._capture: tuple[tuple[Path, int], Capture] | None = None
        self._scan: tuple[Hashable, Cloud | None] | None = None
        self._cut: tuple[Path, cuts.StoredCut] | None = None
        self._fresh = False
        self._stamp = stamp(layout.database)
        self._instead: dict[str, str] = {}  # name of a result -> place, see `making`

    @property
    def layout(self) -> Layout:
        """The present paths; they change when a finished stage puts its new result to use at another place."""
        return Layout(self.root, tuple((results.read_places(self.connection) | self._instead).items()))

    def making(self, places: Mapping[str, str]) -> Project:
        """This open project for a stage that makes a new result: the results in `places` have these paths for it."""
        other = copy.copy(self)
        other._instead = {**self._instead, **places}
        return other

    # Opening ----------------------------------------------------------------------------------------------------

    @staticmethod
    def open(path: Path, *, writable: bool = False) -> Project:
        """Opens an existing project. Raises InputError if `path` does not exist or is not a project, if the project
        has a newer version, or if it must be writable and another process writes it."""
        layout = Layout(Path(path).expanduser().absolute())
        if not layout.root.exists():
            raise InputError(f"{layout.root} does not exist; `nvsim import CAPTURE --project {path}` makes a project.")
        lock = None
        if writable and layout.database.is_file():
            refuse_links_out(layout.root)
            lock = WriterLock(layout.lock)
        try:
            return Project(layout, database.connect_database(layout.database, read_only=not writable), lock)
        except BaseException:
            if lock is not None:
                lock.release()
            raise

    @staticmethod
    def create_or_open(path: Path) -> Project:
        """Opens a project for writing, or creates it if there is none. Raises InputError if the folder contains other
        files, and like `open`."""
        layout = Layout(Path(path).expanduser().absolute())
        if layout.database.is_file():
            return Project.open(layout.root, writable=True)
        ours = {layout.lock.name, layout.built_in_capture.name, layout.ground_truth.name, layout.logs.name}
        ours.add(layout.poses(1).name)  # a refused import keeps the poses that were computed
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
        """Removes a project that `create_or_open` has just created if no stage began, so that a refused import leaves
        no files. Other files in its folder stay."""
        if not self._fresh or self.stage_results() != StageResults():
            return
        self.close()
        layout = Layout(self.root)
        for name in (layout.database.name, *(f"{layout.database.name}-{s}" for s in ("wal", "shm"))):
            (layout.root / name).unlink(missing_ok=True)
        layout.lock.unlink(missing_ok=True)
        if not any(layout.root.iterdir()):
            layout.root.rmdir()

    def close(self) -> None:
        """Closes the project and releases its lock. An open project is also closed at the end of a `with` block."""
        self.connection.close()
        if self._lock is not None:
            self._lock.release()

    def __enter__(self) -> Project:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Commits all changes of the block or none. Raises InputError if the disk reports an error."""
        try:
            self.connection.execute("BEGIN IMMEDIATE")
            try:
                yield self.connection
            except BaseException:
                self.connection.execute("ROLLBACK")
                raise
            self.connection.execute("COMMIT")
        except sqlite3.Error as error:
            raise sqlite_error(self._database, error) from error

    # Reading ----------------------------------------------------------------------------------------------------

    def read(self, table: str, columns: dict[str, CellType], rest: str = "", given: Row = ()) -> list[Row]:
        """Rows of the database, each cell checked against its kind (`nvsim.files.tables`). Raises InputError if it is
        damaged."""
        return tables.read(self.connection, self._database, table, columns, rest, given)

    def stage_results(self) -> StageResults:
        """The results of all stages. Raises InputError if the database is damaged."""
        return results.read(self.connection, self._database)

    def revision(self) -> int:
        """A number that changes when another connection commits. Raises InputError if the database is damaged."""
        if isinstance(self.connection, Snapshot):
            now = stamp(self._database)
            if now != self._stamp:
                past, path = self.connection, self._database
                self.connection, self._stamp = database.connect_database(path, read_only=True), now
                past.close()
            return hash(now)
        with tables.reading_rows(self.connection, self._database):
            return int(self.connection.execute("PRAGMA data_version").fetchone()[0])

    def capture(self) -> Capture | None:
        """The imported capture, None if nothing is imported. Read again only if its file changes."""
        path = self.layout.imported / "capture.json"
        if not path.is_file():
            return None
        stamp = path, path.stat().st_mtime_ns
        if self._capture is None or self._capture[0] != stamp:
            from nvsim.capture.store import load_capture

            self._capture = (stamp, load_capture(path.parent))
        return self._capture[1]

    def need_capture(self) -> Capture:
        """The imported capture. Raises InputError if nothing is imported."""
        capture = self.capture()
        if capture is None:
            raise missing_result_error(self.layout.root, "import")
        return capture

    def scan(self) -> Cloud | None:
        """The point cloud that all stages after the depth stage use. Read again only if its files change.

        If the capture has a LiDAR scan, it is this scan, completed by depth if available. Otherwise, it is the cloud of
        depth images or estimated depth. Without depth, it is the sparse cloud, or None. Raises InputError if nothing is
        imported or files are damaged.
        """
        depth, capture = self.stage_results().depth, self.need_capture()
        stamp = self._capture and self._capture[0], depth and depth.key, self.layout.depth
        if self._scan is None or self._scan[0] != stamp:
            self._scan = stamp, capture.cloud if depth is None else self._scan_with_depth(capture)
        return self._scan[1]

    def dense_points(self) -> NDArray[np.floating] | None:
        """(N, 3) meters: the points of `scan`, which keep simulated robots away from obstacles. None without images, or
        if the cloud is sparse, because a sparse cloud has gaps and many false points."""
        cloud = self.scan() if self.capture() is not None else None
        return None if cloud is None or not cloud.is_dense else cloud.points

    def _scan_with_depth(self, capture: Capture) -> Cloud | None:
        from nvsim.depth.cloud_file import as_cloud, read_cloud_file

        scanned = capture.cloud
        dense = scanned is not None and scanned.is_dense
        seen = as_cloud(read_cloud_file(self.layout.depth / (ADDED if dense else CLOUD)))
        if not len(seen.points):
            return scanned
        if capture.has_measured_depth:
            seen = replace(seen, kind="depth", normals=None)  # as accurate as a LiDAR scan, so used like one
        return scanned.merged_with(seen) if scanned is not None and dense else seen

    def scan_on(self, floor: Floor, places: NDArray[np.floating] | None = None, reach: float = 0.0) -> Cloud | None:
        """Like `scan`, without the noise of estimated depth near `floor`, so that floor does not count as obstacle. If
        `places` (P, 3) in meters are given, far points are removed; see `Cloud.near` for `places` and `reach`."""
        from nvsim.depth.floor_noise import flatten_floor

        cloud = self.scan()
        if cloud is not None and places is not None:
            cloud = cloud.near(places, reach)
        return None if cloud is None else flatten_floor(cloud, floor)

    def submaps(self, of: Cut = "submaps") -> tuple[Submap, ...]:
        """The newest cut of the trajectory, or that of the floors or the models in use. Empty if it is not cut yet. A
        cut of an earlier capture has those of its frames that the capture still has. Raises InputError if the stored
        cut is damaged."""
        cut = self._stored_cut(of)
        return self._submaps_in_rows() if cut is None else self.with_frames_of_capture(cut)

    def submaps_as_cut(self, of: Cut) -> tuple[Submap, ...]:
        """As `submaps`, with all frames and the frame numbers of the capture that was cut. Models and floors that were
        made from it need only the positions."""
        cut = self._stored_cut(of)
        return self._submaps_in_rows() if cut is None else cut.submaps

    def _stored_cut(self, of: Cut = "submaps") -> cuts.StoredCut | None:
        places = dict(self.layout.places)
        place = places.get(f"cut/{of}", places.get("cut/submaps"))
        if place is None:
            return None
        path = self.root / place
        if self._cut is None or self._cut[0] != path:
            self._cut = path, cuts.load_cut(path)
        return self._cut[1]

    def with_frames_of_capture(self, cut: cuts.StoredCut) -> tuple[Submap, ...]:
        """The submaps of a stored cut, with the frame numbers of the present capture if there is one."""
        names = self._frame_names()
        return cut.of_frames(names) if names else cut.submaps

    def has_cut_of_capture(self) -> bool:
        """Whether the newest cut was made from the frames and poses of the present capture."""
        cut = self._stored_cut()  # rows of the database are read with the positions of the capture
        return cut is None or cut.was_made_from(self._frame_names(), self.need_capture().positions)

    def _submaps_in_rows(self) -> tuple[Submap, ...]:
        return cuts.read_rows(self.connection, self._database, lambda: self.need_capture().positions)

    def need_submaps(self) -> tuple[Submap, ...]:
        """The newest cut. Raises InputError if the trajectory is not cut yet."""
        submaps = self.submaps()
        if not submaps:
            raise missing_result_error(self.layout.root, "submaps")
        return submaps

    def graph(self) -> NavGraph | None:
        """The navigation graph, None if there is none. Raises InputError if the database is damaged."""
        return graph_table.read(self.connection, self._database)

    def need_graph(self) -> NavGraph:
        """The navigation graph. Raises InputError if no map is built yet."""
        graph = self.graph()
        if graph is None:
            raise missing_result_error(self.layout.root, "map")
        return graph

    def surface(self, submap: int) -> FloorSurface | None:
        """The floor surface of a submap, None if it is not estimated. Raises InputError if its file is damaged."""
        path = self.layout.surface(submap)
        if not os.path.lexists(path):
            return None
        from nvsim.geometry.floor_surface import FloorSurface

        return FloorSurface.load(path)

    def support(self) -> FloorSupport | StackedSupport | None:
        """The known floor; None if the floor is not found yet. Raises InputError if its file is damaged."""
        if not os.path.lexists(self.layout.support):
            return None
        from nvsim.perception.stacked_support import StackedSupport, is_stacked
        from nvsim.perception.support import FloorSupport
        from nvsim.project.floor_heights import floor_of

        if is_stacked(self.layout.support):
            return StackedSupport.load(self.layout.support, floor_of(self))
        return FloorSupport.load(self.layout.support)

    def scene(self, memory_budget: int | None = None, live: bool = False, colors: bool = True) -> SceneModel | None:
        """The trained models in use as one scene; None if there is none.

        memory_budget  bytes for the models in memory, see SceneModel
        live           use models in training for submaps without a finished model, if all belong to one cut
        colors         False loads gray models, which need less memory
        """
        submaps, layout = self.submaps_as_cut("train"), self.layout
        live = live and not self.uses_previous_submaps("train")
        places = [[layout.model(s.index), *([layout.live_model(s.index)] if live else [])] for s in submaps]
        found = [next((f for f in folders if (f / "model.json").is_file()), None) for folders in places]
        if not any(found):
            return None
        from nvsim.splats.scene import SceneModel

        root = self.root
        # A folder is removed when its training ends, or when newer models replace it while this scene is open.
        return SceneModel(
            submaps, found, memory_budget, moved=lambda index: layout_of(root).model(index), colors=colors
        )

    @property
    def may_have_occupancy(self) -> bool:
        """Whether the project has the files that `occupancy_of` needs."""
        truth = self.layout.true_map
        if truth is not None:
            return truth.is_file()
        return self.layout.occupancy.is_file() or self.layout.support.is_file()

    def results(self) -> dict[str, dict[str, Any]]:
        """Name of an evaluation -> its figures. Raises InputError if the database is damaged."""
        found = {}
        for name, text in self.read("results", {"name": NAME, "figures": TEXT}, "ORDER BY name"):
            with reading(self._database, "a database of results", "run the evaluation again"):
                found[name] = json.loads(text)
            if not isinstance(found[name], dict):
                raise InputError(f"{self._database}: the result {name} has no figures; run the evaluation again.")
        return found

    def result_times(self) -> dict[str, float]:
        """Name of an evaluation -> time at which its figures were stored, in seconds since the epoch."""
        return dict(self.read("results", {"name": NAME, "created": NUMBER}, "ORDER BY name"))

    def uses_previous_submaps(self, stage: StageName) -> bool:
        """Whether the result of `stage` in use belongs to an older cut into submaps than the newest."""
        return stage in self.stage_results().stages_of_previous_cut

    def mask_path(self, frame: int) -> Path:
        """The floor mask in use of a frame: the user's correction, or the mask of the floors stage."""
        return self.layout.mask_in_use(self.need_capture().frames[frame].name, frame)

    @property
    def scan_name(self) -> str:
        """The R2R scan id of the project."""
        return self.layout.scan_name

    # Committing -------------------------------------------------------------------------------------------------

    def set_stage_results(self, value: StageResults) -> None:
        """Stores the results of all stages."""
        with self.transaction() as c:
            results.write(c, value)

    def new_number(self) -> int:
        """The number of the next generation of a result."""
        self.set_stage_results(new := self.stage_results().numbered())
        return new.generation

    def set_submaps(self, submaps: tuple[Submap, ...]) -> None:
        """Stores a new division into submaps, and marks this stage as finished."""
        cut = self.store_cut(submaps)
        found = self.stage_results()
        with self.transaction() as c:
            cuts.write_rows(c, submaps)
            results.write(c, found.finished("submaps", {}, {"cut/submaps": cut}, None))

    def store_cut(self, submaps: tuple[Submap, ...]) -> str:
        """Writes a cut to a separate file and returns its place. If the newest cut is equal, it returns that place."""
        self.fix_cut()
        place = self.stage_results().places.get("cut/submaps")
        if place is not None and cuts.same_cut(self.submaps(), submaps):
            return place
        place = f"cuts/{self.new_number()}.npz"
        cuts.save_cut(self.root / place, submaps, self._frame_names())
        return place

    def _frame_names(self) -> list[str]:
        capture = self.capture()
        return [] if capture is None else [frame.name for frame in capture.frames]

    def fix_cut(self) -> None:
        """Records the cut of the floors and models, in use and kept, before the newest cut changes."""
        newest = self.stage_results().places.get("cut/submaps")
        if newest is None:
            submaps = self._submaps_in_rows()
            if not submaps:
                return
            newest = f"cuts/{self.new_number()}.npz"
            cuts.save_cut(self.root / newest, submaps, self._frame_names())
        elif (cut := self._stored_cut()) and not cut.names and self.capture() and self.has_cut_of_capture():
            cuts.save_cut(self.root / newest, cut.submaps, self._frame_names())  # an earlier version stored no names
            self._cut = None
        found = self.stage_results().completed("in use", "submaps", {"cut/submaps": newest})
        for stage in FROM_A_CUT:
            if found.in_use(stage, self.root) is not None:
                found = found.completed("in use", stage, {f"cut/{stage}": newest})
            if stage in found.restorable_stages:
                found = found.completed("previous", stage, {f"cut/{stage}": newest})
        self.set_stage_results(found)

    def set_graph(self, graph: NavGraph) -> None:
        """Stores `graph` in place of the current one."""
        with self.transaction() as c:
            graph_table.write(c, graph)

    def set_result(self, name: str, figures: dict[str, Any]) -> None:
        """Stores the `figures` of the evaluation `name` with the current time. JSON must be able to hold them."""
        with self.transaction() as c:
            c.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?)", (name, time.time(), json.dumps(figures)))


def layout_of(root: Path) -> Layout:
    """The layout of a project with its results in use. The project need not be open."""
    plain = Layout(root)
    try:
        connection = database.connect_database(plain.database, read_only=True)
    except Exception:  # not a readable project: the error is reported when it is opened
        return plain
    try:
        return Layout(root, tuple(results.read_places(connection).items()))
    except sqlite3.Error:
        return plain
    finally:
        connection.close()
