"""The contents of a project that the window shows, as one frozen value, and their reader. Does not use Qt."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field, replace
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from nvsim.capture.types import Capture, Cloud
from nvsim.errors import InputError
from nvsim.graph.findings import Context
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.types import OccupancyMap
from nvsim.project.state.results import first_outdated_stage
from nvsim.project.work import STAGE, StageName, sentence
from nvsim.submaps.split import Submap
from nvsim_app.painting.dots import Dots
from nvsim_app.processes.child import Child
from nvsim_app.state.graph_arrays import GraphArrays, TrajectoryArrays
from nvsim_app.state.graph_files import GraphFile, ProjectGraph
from nvsim_app.state.side_work import start_reading

if TYPE_CHECKING:
    from nvsim.project.project import Project
    from nvsim.reconstruction.report import PosesReport

CONTENT_PARTS = (
    "capture", "submaps", "graph", "occupancy", "context", "scene_stamp", "outline", "model_info", "stages",
    "results", "training", "cloud", "growing", "poses", "chosen", "reading",
)  # fmt: skip


@dataclass(frozen=True)
class ChosenFrames:
    """The images that a pose computation has stored so far: their number, and the file of the last one."""

    count: int
    last: Path


@dataclass(frozen=True, eq=False)
class Contents:
    """The contents of a project after the last reading. Views compare its parts by identity.

    scene_stamp             changes whenever a model is written; None if there is no model
    model_info              submap index -> training results ("psnr", "gaussians", ...); empty if the models belong to a
                            previous division into submaps
    training                submap index -> training step of the last saved state of a running or interrupted training
    stages_of_previous_cut  stages of "floors" and "train" whose result belongs to a previous division into submaps
    restorable_stages       stages of which an earlier result can be restored
    stages                  names of the stages that finished successfully
    outdated_stages         stages whose result was computed from another capture than the present one, or before the
                            user removed Gaussians
    thresholds              thresholds that the graph was decided with
    context                 context of the validation of the graph; None if only thresholds and map are known
    results                 name of a stored evaluation -> time of its end and its results
    live                    whether all displayed models are still in training
    held_out                frames of the capture that no model is trained on
    modified_time           time of the newest model in use, or else of the capture: seconds since the epoch, 0 for none
    outline                 (N, 3) meters, world: positions around the content of a splat file; None for a project
    graph_file              storage of the graph; None if it cannot be saved
    growing                 cameras of a video whose poses are being computed, while there is no capture
    chosen                  frames or photos that a running pose computation has stored so far; None unless there are
                            some and no camera has a pose
    camera_height           height of the cameras above the floor in meters, None if the user gave none
    poses                   report about the camera poses of the capture's video, None for other captures; while there
                            is no capture, the newest report
    cloud                   point cloud beside a graph file, or from the estimated depth of a project; None if there is
                            none
    reading                 whether the file is still being read, so that an absent part may exist
    notes                   notices for the user about an opened file, shown once
    arrays, dots            precomputed arrays of the graph `arrays_of`, and of the cloud
    """

    path: Path | None = None
    capture: Capture | None = None
    submaps: tuple[Submap, ...] = ()
    graph: NavGraph | None = None
    occupancy: OccupancyMap | None = None
    scene_stamp: Hashable | None = None
    model_info: dict[int, dict[str, object]] = field(default_factory=dict)
    stages: frozenset[StageName] = frozenset()
    training: dict[int, int] = field(default_factory=dict)
    stages_of_previous_cut: frozenset[StageName] = frozenset()
    restorable_stages: frozenset[StageName] = frozenset()
    outdated_stages: frozenset[StageName] = frozenset()
    outline: NDArray[np.float64] | None = None
    thresholds: MappingConfig = field(default_factory=MappingConfig)
    live: bool = False
    held_out: frozenset[int] = frozenset()
    modified_time: float = 0.0
    results: dict[str, tuple[float, dict[str, object]]] = field(default_factory=dict)
    graph_file: GraphFile | None = None
    cloud: Cloud | None = None
    notes: tuple[str, ...] = ()
    arrays: GraphArrays | None = None
    arrays_of: NavGraph | None = None
    dots: Dots | None = None
    context: Context | None = None
    camera_height: float | None = None
    poses: PosesReport | None = None
    growing: TrajectoryArrays | None = None
    chosen: ChosenFrames | None = None
    reading: bool = False

    @property
    def scan_cloud(self) -> Cloud | None:
        """The point cloud: beside the graph, from estimated depth, or of the capture. None if there is none."""
        return self.cloud if self.capture is None or self.cloud is not None else self.capture.cloud

    @property
    def has_images(self) -> bool:
        """Whether stages that need images apply: not in a project from splat files."""
        return self.capture is None or self.capture.has_images

    @property
    def missing_verb(self) -> StageName | Literal[""]:
        """The stage that the project needs next; "" if nothing is missing, no project is open, or it is being read."""
        if self.reading:
            return ""
        stale, trained = self._stale, self.scene_stamp is not None and not self.live
        if stale is not None:
            return stale[0]
        if self.path is None or self.outline is not None or (self.graph is not None and trained):
            return ""
        if self.capture is None:
            return "" if self.graph is not None else "import"
        if not self.capture.has_images:
            return "map" if "floors" in self.stages else "floors"
        if not self.submaps:
            return "submaps"
        if "floors" not in self.stages and not trained:
            scanned = self.capture.cloud is not None and self.capture.cloud.is_dense
            return "floors" if scanned or "depth" in self.stages else "depth"
        return "map" if trained else "train"

    @property
    def _stale(self) -> tuple[StageName, str] | None:
        nothing = self.capture is None and self.graph is None
        if nothing:
            return None
        content = "capture" if self.has_images else "splat"
        return first_outdated_stage(self.outdated_stages, self.stages_of_previous_cut, content)

    @property
    def missing(self) -> str:
        """A sentence about the next missing result, "" if nothing is missing."""
        if self.outline is not None or (self.graph_file is not None and self.graph_file.foreign):
            return ""
        if self.path is None:
            return "No project is open."
        if self.reading:
            return "Reading the file…" if self.capture is None and self.graph is None else ""
        verb = self.missing_verb
        if not verb:
            return ""
        return sentence(STAGE[verb].missing) if self._stale is None else self._stale[1]


def with_derived_arrays(contents: Contents) -> Contents:
    """`contents` with the arrays that views derive from the graph and the cloud, computed here instead of in the main
    thread."""
    graph, cloud = contents.graph, contents.scan_cloud
    if contents.occupancy is not None:
        _ = contents.occupancy.room  # fills the cache, as below for the graph
    if graph is not None:
        _ = graph.adjacency
    dots = contents.dots
    if cloud is None or dots is None or dots.cloud is not cloud:
        dots = None if cloud is None else Dots.of(cloud)
    arrays = contents.arrays
    if graph is not contents.arrays_of:
        arrays = None if graph is None else GraphArrays.of(graph)
    return replace(contents, arrays=arrays, arrays_of=graph, dots=dots)


def _file_stamp(path: Path) -> tuple[int, int] | None:
    try:
        stat = path.stat()
    except OSError:
        return None
    return stat.st_mtime_ns, stat.st_size


class ProjectReader:
    """Reads a project repeatedly; each part is read only if it changed. Use it in one thread."""

    def __init__(self, path: Path) -> None:
        """Raises InputError if there is no project, or if a newer version of NVSim wrote it."""
        from nvsim.project.jobs.joblist import JobList
        from nvsim.project.project import Project

        self._project: Project = Project.open(path)
        self._jobs = JobList(path)
        self._contents = Contents(path, graph_file=ProjectGraph(path), reading=True)
        self._stamps: dict[str, Hashable] = {}
        self._revision: Hashable = None
        self._child: Child | None = None
        self._interrupted = False
        self._live: dict[Path, tuple[tuple[int, int] | None, int]] = {}  # model file -> its time stamp and step

    def close(self) -> None:
        self._interrupted = True
        self._drop_child()
        self._project.close()

    def interrupt(self) -> None:
        """Cancels the current reading. Can be called from any thread."""
        self._interrupted = True
        child = self._child
        if child is not None:
            child.kill()

    def updates(self) -> Iterator[Contents]:
        """Yields the contents after each changed part, fast parts first; nothing if there is no change. Raises
        InputError if a file of the project is damaged."""
        from nvsim.project.graph import thresholds_of
        from nvsim.project.outdated import outdated_stages

        project = self._project
        models, training = self._models(), self._training()
        if training != self._contents.training:
            self._contents = replace(self._contents, training=training)
            yield self._contents
        growing, poses = self._unfinished()
        chosen = self._chosen(growing)
        if (
            growing is not self._contents.growing
            or poses is not self._contents.poses
            or chosen != self._contents.chosen
        ):
            self._contents = replace(self._contents, growing=growing, poses=poses, chosen=chosen)
            yield self._contents
        revision = project.revision(), self._jobs.stamp()  # some commands write files of the project alone
        if revision == self._revision and models == self._stamps.get("scene_stamp"):
            return
        self._revision = revision
        states = project.stage_results()
        stages, content = tuple(states.results.items()), self._content_key()
        capture, depth = _file_stamp(project.layout.imported / "capture.json"), states.depth
        built = _file_stamp(project.layout.occupancy)
        stamps: dict[str, Hashable] = {
            "capture": capture,
            "cloud": (capture, depth and depth.key, project.layout.depth),
            "submaps": (capture, stages),
            "graph": stages,
            "stages": (stages, content),
            "results": tuple(project.result_times().items()),
            "scene_stamp": models,
            "occupancy": (capture, _file_stamp(project.layout.support), built),
            "context": self._context_stamp(stages, (capture, _file_stamp(project.layout.support), built)),
        }
        readers: dict[str, Callable[[], Any]] = {
            "capture": project.capture,
            "cloud": lambda: None if depth is None else project.scan(),
            "submaps": project.submaps,
            "stages": lambda: states.finished_stages,
            "results": lambda: self._results(stamps["results"]),
            "graph": project.graph,
            "scene_stamp": lambda: models,
            "occupancy": self._occupancy,
            "context": self._context,
        }
        if self._stamps.get("occupancy", self) != stamps["occupancy"]:
            self._drop_child()
            if project.may_have_occupancy:
                self._child = start_reading(project.layout.root)
        for part, read in readers.items():
            if self._stamps.get(part, self) == stamps[part]:
                continue
            before = getattr(self._contents, part)
            value = read()
            self._stamps[part] = stamps[part]
            if value is None and before is None:
                continue
            self._contents = replace(self._contents, **{part: value})
            if part in ("capture", "cloud", "occupancy"):
                self._contents = with_derived_arrays(self._contents)
            if part == "capture":
                held_out, height = self._as_imported()
                self._contents = replace(self._contents, held_out=held_out, camera_height=height, poses=self._poses())
            if part in ("capture", "scene_stamp"):
                self._contents = replace(self._contents, modified_time=self._modification_time())
            if part == "stages":
                self._contents = replace(
                    self._contents,
                    outdated_stages=outdated_stages(project) if content else frozenset(),
                    stages_of_previous_cut=states.stages_of_previous_cut,
                    restorable_stages=states.restorable_stages,
                )
            if part == "graph":
                self._contents = with_derived_arrays(replace(self._contents, thresholds=thresholds_of(project)))
            if part == "scene_stamp":
                self._contents = replace(
                    self._contents, model_info=self._model_info(), live=value is not None and not self._folders()
                )
            yield self._contents
        if self._contents.reading:
            self._contents = replace(self._contents, reading=False)
            yield self._contents

    def _content_key(self) -> str:
        """See `ledger.content_key`; "" if files are damaged, which the reader of these files reports."""
        from nvsim.project.ledger import content_key

        with contextlib.suppress(InputError):
            return content_key(self._project)
        return ""

    def _occupancy(self) -> OccupancyMap | None:
        if self._child is None:
            return None
        try:
            if self._interrupted:
                self._child.kill()
            return self._child.result()
        finally:
            self._child = None

    def _drop_child(self) -> None:
        if self._child is not None:
            self._child.end()
            self._child = None

    def _context_stamp(self, stages: Hashable, stamp_of_map: Hashable) -> Hashable:
        layout = self._project.layout
        floors = tuple((p.name, _file_stamp(p)) for p in sorted(layout.floor.glob("*.npz")))
        return stages, floors, stamp_of_map, tuple(self._folders())

    def _context(self) -> Context | None:
        from nvsim.project.graph import context_on

        if self._contents.graph is None:
            return None
        return context_on(self._contents.occupancy, self._project)

    def _results(self, created: Hashable) -> dict[str, tuple[float, dict[str, object]]]:
        assert isinstance(created, tuple)
        figures = self._project.results()
        return {name: (at, figures[name]) for name, at in created if name in figures}

    def _as_imported(self) -> tuple[frozenset[int], float | None]:
        """The held-out frames and the given camera height."""
        from nvsim.project.config import held_out
        from nvsim.project.stages.imported import capture_config

        capture = self._contents.capture
        if capture is None:
            return frozenset(), None
        config = capture_config(self._project)
        return held_out(len(capture.frames), config.hold_out), config.camera_height

    def _poses(self) -> PosesReport | None:
        from nvsim.reconstruction.report import report_beside

        capture = self._contents.capture
        with contextlib.suppress(InputError):  # a damaged report must not prevent reading other parts
            return None if capture is None else report_beside(capture.source)
        return None

    def _unfinished(self) -> tuple[TrajectoryArrays | None, PosesReport | None]:
        """The newest cameras of a video whose poses are computed, and the newest report, while there is no capture. The
        last read values are kept until there is a capture."""
        from nvsim.reconstruction.computing import WORK
        from nvsim.reconstruction.growing_trajectory import GROWING, read_growing
        from nvsim.reconstruction.report import REPORT, read_report

        growing, poses = self._contents.growing, self._contents.poses
        if self._contents.capture is not None:
            return None, poses
        folders = list(takewhile(Path.is_dir, map(self._project.layout.poses, count(1))))
        with contextlib.suppress(InputError):  # the file is being replaced or removed, or is damaged
            if (path := self._newest("growing", [f / WORK / GROWING for f in folders])) is not None:
                growing = TrajectoryArrays.from_growing(read_growing(path))
            if (path := self._newest("poses", [f / REPORT for f in folders])) is not None:
                poses = read_report(path.parent)
        return growing, poses

    def _chosen(self, growing: TrajectoryArrays | None) -> ChosenFrames | None:
        from nvsim.reconstruction.computing import IMAGES, WORK

        if growing is not None or self._contents.capture is not None:
            return None
        folders = list(takewhile(Path.is_dir, map(self._project.layout.poses, count(1))))
        if not folders or not (folders[-1] / WORK).is_dir():
            return None
        with contextlib.suppress(OSError):
            names = [name for name in os.listdir(folders[-1] / IMAGES) if name.endswith(".jpg")]
            if names:
                return ChosenFrames(len(names), folders[-1] / IMAGES / max(names))
        return None

    def _newest(self, part: str, paths: list[Path]) -> Path | None:
        """The most recently changed file; None if it has not changed since the last call."""
        stamps = [(stamp, path) for path in paths if (stamp := _file_stamp(path)) is not None]
        if not stamps or max(stamps) == self._stamps.get(part):
            return None
        self._stamps[part] = max(stamps)
        return max(stamps)[1]

    def _modification_time(self) -> float:
        files = [self._project.layout.imported / "capture.json", *(f / "model.json" for f in self._folders().values())]
        return max((stamp[0] / 1e9 for file in files if (stamp := _file_stamp(file)) is not None), default=0.0)

    def _folders(self) -> dict[int, Path]:
        from nvsim.project.state.results import model_folders

        return model_folders(self._project.layout)

    def _models(self) -> Hashable | None:
        layout, folders = self._project.layout, self._folders()
        found: list[Hashable] = [(f.name, _file_stamp(f / "model.json")) for f in folders.values()]
        if folders and self._project.uses_previous_submaps("train"):
            return ("former", *found)
        # The renderer checks for new states of these by itself. Submaps with a finished model do not show them.
        live = sorted(p.parent.name for p in layout.checkpoints.glob("live_*/model.json"))
        found += [name for name in live if name not in {layout.live_model(i).name for i in folders}]
        return tuple(found) or None

    def _training(self) -> dict[int, int]:
        from nvsim.files.opening import read_json

        found = {}
        for path in sorted(self._project.layout.checkpoints.glob("live_*/model.json")):
            stamp = _file_stamp(path)
            if path not in self._live or self._live[path][0] != stamp:
                with contextlib.suppress(InputError, ValueError, KeyError, TypeError):  # the file is being replaced
                    data = read_json(path, "the description of a model", "run “Train” again", strict=False)
                    self._live[path] = stamp, int(data["info"]["steps"])
            index = path.parent.name.removeprefix("live_")
            if index.isdecimal() and path in self._live:
                found[int(index)] = self._live[path][1]
        return found

    def _model_info(self) -> dict[int, dict[str, object]]:
        from nvsim.files.opening import read_json
        from nvsim.files.reading import reading

        result: dict[int, dict[str, object]] = {}
        if self._project.uses_previous_submaps("train"):
            return result
        what, then = "the description of a model", "run “Train” again"
        for index, folder in self._folders().items():
            path = folder / "model.json"
            data = read_json(path, what, then, strict=False)
            with reading(path, what, then):
                info = {"gaussians": data.get("count", 0) - data.get("removed", 0), **data.get("info", {})}
                result[index] = info
        return result
