"""The work of short side processes: they calibrate thresholds, measure viewpoints, read occupancy maps, list networks,
and check recent projects. Does not use Qt.

In a thread, this work would make the window stutter: Python holds its global lock during long computations, and while
it loads OpenCV. A process also limits memory, and a disk that does not respond does not block the window.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from nvsim.errors import InputError
from nvsim.evaluation.calibrated import Calibration
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.evidence.new_viewpoints import NewViewpointEvidence
from nvsim.occupancy.types import OccupancyMap
from nvsim.project.layout import Layout
from nvsim_app.processes.child import Child, ChildProgram
from nvsim_app.processes.serving import Requests

if TYPE_CHECKING:
    from nvsim.scene_import.cleaning import Reason

_NO_MAP = (
    "There is no occupancy map to compare with: select one with Map…, or compute one from the capture in a terminal."
)


@dataclass(frozen=True, eq=False)
class CalibrationRequest:
    """The input of a calibration.

    graph        the displayed graph
    config       the thresholds to evaluate
    truth        the file of an occupancy map, None for the map of the project
    in_capture   whether `truth` is in the coordinate frame of the capture instead of the project
    want         the required lower bound of the validity
    """

    project: Path
    graph: NavGraph
    config: MappingConfig
    truth: Path | None = None
    in_capture: bool = False
    want: float = 0.99

    def __reduce__(self) -> tuple[object, ...]:
        """Encodes the graph, because pickling it would block the window for longer."""
        from nvsim.graph.store import encode_graph

        return _decoded_calibration, (
            encode_graph(self.graph),
            self.project,
            self.config,
            self.truth,
            self.in_capture,
            self.want,
        )


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """The result of a calibration, and the occupancy map that was used."""

    found: Calibration
    map: Path


def _decoded_calibration(graph: bytes, project: Path, *rest: Any) -> CalibrationRequest:
    from nvsim.graph.store import decode_graph

    return CalibrationRequest(project, decode_graph(graph), *rest)


def _calibrate(requests: Requests, asked: CalibrationRequest) -> CalibrationResult:
    from nvsim.evaluation.calibration import calibrate
    from nvsim.evaluation.truth import true_occupancy
    from nvsim.project.occupancy_maps import true_map
    from nvsim.project.project import Project

    with Project.open(asked.project) as project:
        truth = asked.truth or true_map(project)
        if truth is None:
            raise InputError(_NO_MAP)
        frame = "capture" if asked.truth is not None and asked.in_capture else "aligned"
        occupancy, positions = true_occupancy(project, truth, frame), project.need_capture().positions
    config = asked.config
    return CalibrationResult(
        calibrate(asked.graph, occupancy, positions, config, asked.want, config.robot_radius), truth
    )


CALIBRATION = ChildProgram(_calibrate, "calibration", "The thresholds cannot be calibrated")
"""Asked -> Calibrated"""


AROUND = 8.0  # meters; viewpoints farther from the measured ones do not affect the result


@dataclass(frozen=True, eq=False)
class EvidenceTask:
    """Measures the viewpoints `ids` of `graph`, a part of the project's graph."""

    project: Path
    graph: NavGraph
    ids: tuple[str, ...]

    def __reduce__(self) -> tuple[object, ...]:
        """Encodes the graph, because its read-only mappings cannot be pickled."""
        from nvsim.graph.store import encode_graph

        return _decoded, (self.project, encode_graph(self.graph), self.ids)


@dataclass(frozen=True, eq=False)
class MeasuredEvidence:
    """The evidence, and the measured positions by viewpoint id."""

    evidence: NewViewpointEvidence
    positions: dict[str, tuple[float, float, float]]


def _decoded(project: Path, graph: bytes, ids: tuple[str, ...]) -> EvidenceTask:
    from nvsim.graph.store import decode_graph

    return EvidenceTask(project, decode_graph(graph), ids)


def evidence_task(project: Path, graph: NavGraph, ids: Sequence[str]) -> EvidenceTask:
    """The task to measure the viewpoints `ids` of `graph`."""
    return EvidenceTask(project, _part(graph, tuple(ids)), tuple(ids))


def _measure(requests: Requests, task: EvidenceTask) -> MeasuredEvidence:
    from nvsim.cli.arguments import memory_budget
    from nvsim.mapping.config import MappingConfig
    from nvsim.project.project import Project
    from nvsim.project.stages.measured import measure

    with Project.open(task.project) as project:
        found = measure(project, task.graph, task.ids, MappingConfig(), lambda event: None, memory_budget(None))
    return MeasuredEvidence(found, {id: task.graph.viewpoints[id].position for id in task.ids})


def _part(graph: NavGraph, ids: tuple[str, ...]) -> NavGraph:
    """The part of the graph that affects the measurement: near viewpoints with their edges and corridors."""
    centers = [graph.viewpoints[id].position for id in ids]
    near = {
        id: v for id, v in graph.viewpoints.items() if any(math.dist(v.position, center) < AROUND for center in centers)
    }
    for id in ids:
        near |= {other: graph.viewpoints[other] for other in graph.neighbors(id)}
    return NavGraph(
        graph.scan,
        near,
        {key: e for key, e in graph.edges.items() if key[0] in near and key[1] in near},
        {key: e for key, e in graph.evidence.items() if e.joins and e.viewpoint in near and e.joins in near},
    )


EVIDENCE = ChildProgram(_measure, "evidence", "The viewpoints cannot be measured")
"""EvidenceTask -> Measured"""


@dataclass(frozen=True, eq=False)
class RemovableGaussians:
    """The Gaussians of a project from splat files, see `nvsim.project.cleaning`.

    means       (N, 3) float32 meters, world
    rows        submap -> (n,) rows of its Gaussians
    removed     (N,) bool, removed now
    candidates  reason -> (N,) bool, Gaussians that should be removed for it
    """

    means: NDArray[np.float32]
    rows: dict[int, NDArray[np.int64]]
    removed: NDArray[np.bool_]
    candidates: dict[Reason, NDArray[np.bool_]]


def _find_removable(requests: Requests, path: Path) -> RemovableGaussians:
    from nvsim.project.cleaning import read_whole_splat, removal_candidates
    from nvsim.project.project import Project

    with Project.open(path) as project:
        whole = read_whole_splat(project)
        candidates = removal_candidates(project, whole)
    return RemovableGaussians(whole.model.gaussians.means, whole.rows, whole.removed, candidates)


CLEANING = ChildProgram(_find_removable, "cleaning", "The Gaussians to remove cannot be found")
"""Path of a project -> RemovableGaussians"""


Found = dict[str, Any]
"""{"catalogue": …} in the format of `nvsim.networks.catalog.Catalog`, with {"checked": {name: …}} for tested models
and {"added": name} for an installed model."""


@dataclass(frozen=True)
class ModelTask:
    """Tests the models `check`, or installs the absolute paths `add`; then all models are listed."""

    check: tuple[str, ...] = ()
    add: tuple[Path, ...] = ()


def _work(requests: Requests, task: ModelTask) -> Found:
    from nvsim.networks.catalog import catalog

    found: Found = {"checked": {}, "added": ""}
    if task.add:
        from nvsim.networks.installation import add

        found["added"] = add(list(task.add)).name
    if task.check:
        from nvsim.networks.installed import bundled_models, installed_models
        from nvsim.perception.checking import check

        known = {model.name: model for model in (*installed_models()[0], *bundled_models())}
        found["checked"] = {name: asdict(check(known[name])) for name in task.check if name in known}
    found["catalogue"] = catalog().as_dict()
    return found


MODELS = ChildProgram(_work, "models", "The networks cannot be listed")
"""ModelTask -> Found"""


_MEMORY = 4 << 30  # bytes; a map of a square kilometer needs 0.4 GB


def start_reading(path: Path) -> Child:
    """Starts to read the map of a project folder or a map file. The result is an OccupancyMap, None if a project has no
    map."""
    return Child(_PROGRAM, path)


def _read(requests: Requests, path: Path) -> OccupancyMap | None:
    if path.is_file():
        from nvsim.occupancy.read import read_map

        return read_map(path)
    from nvsim.project.occupancy_maps import occupancy_of
    from nvsim.project.project import Project

    with Project.open(path) as project:
        return occupancy_of(project)


_PROGRAM = ChildProgram(
    _read,
    "occupancy",
    "The occupancy map cannot be read",
    "close other programs and open the project again",
    memory=_MEMORY,
)


PICTURE = (240, 160)  # size of the area that an image must cover, pixels
LAST_VIEW = "view.jpg"
"""File in the cache of a project: the last image of the 3D view when the project was closed."""


@dataclass(frozen=True)
class ProjectPreview:
    """The result for one project.

    there    whether it is a project that can be opened
    picture  JPEG, b"" if the project has no image
    """

    there: bool
    picture: bytes


def look_at(project: Path) -> ProjectPreview:
    """Checks one project. Never raises; a project that cannot be read has no image."""
    from nvsim.project.path_kind import path_kind

    if path_kind(project) != "project":
        return ProjectPreview(False, b"")
    for image in _images(project):
        try:
            return ProjectPreview(True, _preview_bytes(image))
        except InputError:
            continue
    return ProjectPreview(True, b"")


def _images(project: Path) -> Iterator[Path]:
    """Existing images of the project, the most informative first."""
    from nvsim.files.opening import is_regular, read_json
    from nvsim.project.project import Project

    layout = Layout(project)
    if is_regular(layout.cache / LAST_VIEW):
        yield layout.cache / LAST_VIEW
    try:
        with Project.open(project) as opened:
            layout = opened.layout
        tree = read_json(layout.imported / "capture.json", "a stored capture", "import it again")
        frames = tree["frames"]
        yield Path(str(frames[len(frames) // 2]["image"]))
    except (InputError, OSError, KeyError, TypeError, IndexError, ValueError):
        pass
    thumbnails = sorted((layout.cache / "thumbnails").glob("*.jpg"))
    yield from thumbnails[len(thumbnails) // 2 :][:1]


def _preview_bytes(image: Path) -> bytes:
    """The image as JPEG, reduced so that it just covers PICTURE. Raises InputError if the file is not an image."""
    import cv2

    from nvsim.capture.images import decode

    pixels = decode(image)
    height, width = pixels.shape[:2]
    share = min(1.0, max(PICTURE[0] / width, PICTURE[1] / height))  # the view crops it
    size = max(1, round(width * share)), max(1, round(height * share))
    small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, 85])[1])


def _look_at_projects(requests: Requests, projects: tuple[Path, ...]) -> dict[Path, ProjectPreview]:
    return {project: look_at(project) for project in projects}


RECENT = ChildProgram(_look_at_projects, "recent projects", "Recent projects cannot be checked", memory=1 << 30)
"""Paths of projects -> path -> Looked"""
