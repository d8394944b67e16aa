"""Make the paper's fourth table for one project: the validity of maps by scene representation and set of criteria.

The models are those of the ablation. Missing ones are trained. A map of the table is stored in a folder that is named
by a hash of its inputs:

P/validity/KEY/cell.json    after the build: the inputs and the builder's report, or the reason for no map
P/validity/KEY/graph.zip    the graph with its evidence
P/validity/KEY/measured.zip all evidence that it was built from, for other criteria
P/validity/KEY/partial.zip  evidence during the build; the project's own graph is never changed
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nvsim import __version__
from nvsim.errors import InputError
from nvsim.evaluation.ablation_runs import (
    AblationRow,
    Budget,
    SharedViews,
    TrainingRun,
    preset_rows,
    progress_of_run,
    train_or_load,
    training_run,
)
from nvsim.evaluation.graph import evaluate_graph
from nvsim.events import Listener, Log
from nvsim.files import atomic
from nvsim.files.opening import read_bytes, read_json
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.explanation.poor_graph import NoViewpointFound
from nvsim.mapping.families import NETWORK_NORMAL
from nvsim.occupancy.types import OccupancyMap
from nvsim.perception.normals_network import normals_model
from nvsim.project import ledger
from nvsim.project.corrections import corrections_key
from nvsim.project.floor_heights import floor_of
from nvsim.project.project import Project
from nvsim.project.stages.floors import floors_key, refresh_support, supporting_frames
from nvsim.project.work import missing_result_error

_VERSION = 1  # to be raised if the same models, thresholds, and release would give another map
STAGE = "validity-table"
Criteria = tuple[str, ...]
COLUMNS: tuple[Criteria, ...] = (("alpha", "normal"), ("alpha",), ("normal",), ("depth",), ("slice",))
"""Sets of criteria, named as in the map builder. The first four are the paper's."""


@dataclass(frozen=True)
class StoredMap:
    """The files of one stored map."""

    folder: Path

    @property
    def result_file(self) -> Path:
        return self.folder / "cell.json"

    @property
    def graph(self) -> Path:
        return self.folder / "graph.zip"

    @property
    def measured(self) -> Path:
        return self.folder / "measured.zip"

    @property
    def partial(self) -> Path:
        return self.folder / "partial.zip"

    @property
    def is_done(self) -> bool:
        return self.result_file.is_file()

    def read(self) -> tuple[NavGraph | None, dict[str, Any]]:
        """The graph and its report. The graph is None if there was no free place. Raises InputError if a file is
        damaged."""
        again = "delete the folder and run the command again"
        said = read_json(self.result_file, "the report of a map", again)
        report = said.get("report") if isinstance(said, dict) else None
        if not isinstance(report, dict) or not ("seconds" in report or "why" in report):
            raise InputError(f"{self.result_file} is not the report of a map; {again}.")
        return (None if "why" in report else decode_graph(read_bytes(self.graph))), report


def cells_folder(project: Project) -> Path:
    return project.layout.root / "validity"


def stored_map_of(project: Project, runs: Sequence[TrainingRun], config: MappingConfig) -> StoredMap:
    """The folder of the map that these models, one per submap, give with `config`."""
    corrected = corrections_key(project, supporting_frames(project))
    program = (__version__, _VERSION)
    key = ledger.key_of("validity", program, [run.folder.name for run in runs], config, *corrected)
    return StoredMap(cells_folder(project) / key)


def build_stored_map(
    project: Project,
    runs: Sequence[TrainingRun],
    config: MappingConfig,
    kept: StoredMap,
    known: Sequence[StoredMap],
    listen: Listener,
) -> None:
    """Builds the map, and continues an interrupted build. Measurements in the `known` maps of the same models are
    reused. Raises InputError if the disk refuses."""
    from nvsim.mapping.builder import build_map
    from nvsim.project.scene_views import SceneViews
    from nvsim.splats.scene import SceneModel

    support = project.support()
    assert support is not None
    scan = "table"
    files = [path for path in (*(other.measured for other in known), kept.partial) if path.is_file()]
    corridors = {
        (e.viewpoint, e.joins or e.direction): e
        for path in files
        for e in decode_graph(read_bytes(path)).evidence.values()
    }
    evidence = {(e.viewpoint, i): e for i, e in enumerate(corridors.values())}
    scene = SceneModel([run.submap for run in runs], [run.model_folder for run in runs])
    said: dict[str, Any] = {"models": [run.folder.name for run in runs], "config": dataclasses.asdict(config)}
    positions = project.need_capture().positions
    try:
        result = build_map(
            SceneViews(scene, config),
            positions,
            floor_of(project).height_at,
            support.is_supported,
            config,
            scan=scan,
            remembered=NavGraph(scan, evidence=evidence),
            listen=listen,
            keep=lambda graph: atomic.write_bytes(kept.partial, encode_graph(graph)),
        )
        atomic.write_bytes(kept.measured, encode_graph(result.measured))
        atomic.write_bytes(kept.graph, encode_graph(result.graph))
        said["report"] = result.report
    except NoViewpointFound as error:
        said["report"] = {"why": str(error)}
    atomic.write_text(kept.result_file, json.dumps(said, indent=1) + "\n")
    kept.partial.unlink(missing_ok=True)


@dataclass(frozen=True)
class TableConfig:
    """Models to train and maps to build.

    presets        empty for all
    columns        sets of criteria
    budget, seed   of the trainings
    mapping        configuration of all maps except for their criteria
    robot_radius   meters
    repeat         whether to rebuild existing maps
    """

    presets: tuple[str, ...] = ()
    columns: tuple[Criteria, ...] = COLUMNS
    budget: Budget = field(default_factory=Budget)
    seed: int = 0
    mapping: MappingConfig = field(default_factory=MappingConfig)
    robot_radius: float = 0.25
    repeat: bool = False


@dataclass(frozen=True, eq=False)
class ValidityCell:
    """Metrics of `evaluate_graph` and the build time of one map in seconds. If there is no map, `why` is the reason."""

    model: str
    criteria: Criteria
    figures: dict[str, Any]
    graph: NavGraph | None
    why: str = ""


@dataclass(frozen=True, eq=False)
class ValidityTable:
    """The table of validities.

    cells           in the order of rows, then columns
    left_out        a sentence about skipped columns, "" if there are none
    trained, built, reused   numbers of trained models, built maps, and reused maps
    """

    models: tuple[str, ...]
    columns: tuple[Criteria, ...]
    cells: list[ValidityCell]
    left_out: str
    trained: int
    built: int
    reused: int


def evaluate_validity(
    project: Project, config: TableConfig, occupancy: OccupancyMap, listen: Listener
) -> ValidityTable:
    """Trains and builds missing parts, and tests every map on `occupancy`, which is in the project's aligned frame.

    A cell whose builder finds no free place has no map, like the dashes in the paper. Raises InputError if the project
    has no floor masks, a preset does not exist, or no column is possible.
    """
    if not floors_key(project):
        raise missing_result_error(project.layout.root, "floors")
    rows = preset_rows(config.budget, config.presets)
    wanted = {criteria: with_criteria(config.mapping, criteria) for criteria in config.columns}
    columns = {criteria: found for criteria, found in wanted.items() if found is not None}
    if not columns:
        raise InputError(f"{_left_out(wanted)} Name an available column with --columns.")
    refresh_support(project, listen)
    runs, trained = _finished_runs(project, rows, config.seed, listen)
    support = project.support()
    assert support is not None
    walk = project.need_capture().positions[:, :2]
    cells, built = [], 0
    for row in rows:
        known: list[StoredMap] = []  # measurements of other columns, so that each corridor is rendered once for all
        for criteria, mapping in columns.items():
            kept = stored_map_of(project, runs[row], mapping)
            if config.repeat or not kept.is_done:
                listen(Log(f"Building the map of {row.name} by {' & '.join(criteria)}.", STAGE))
                build_stored_map(project, runs[row], mapping, kept, known, listen)
                built += 1
            cells.append(
                _evaluate_cell(row.name, criteria, kept, occupancy, walk, config.robot_radius, support.is_supported)
            )
            known.append(kept)
    reused = len(cells) - built
    return ValidityTable(
        tuple(row.name for row in rows), tuple(columns), cells, _left_out(wanted), trained, built, reused
    )


def with_criteria(config: MappingConfig, criteria: Criteria) -> MappingConfig | None:
    """`config` with only these criteria and that of known floor. None if the builder does not have them, or if
    they need a network that is not installed."""
    if NETWORK_NORMAL in criteria and normals_model() is None:
        return None
    try:
        return dataclasses.replace(config, criteria=criteria)
    except InputError:
        return None


def _finished_runs(
    project: Project, rows: Sequence[AblationRow], seed: int, listen: Listener
) -> tuple[dict[AblationRow, list[TrainingRun]], int]:
    """The finished runs of every row, one per submap, and the number of runs that were trained."""
    submaps = project.need_submaps()
    runs = {row: [training_run(project, submap, row.config, seed) for submap in submaps] for row in rows}
    todo = {run.folder for of_row in runs.values() for run in of_row if not run.is_done}
    count = sum(map(len, runs.values()))
    listen(Log(f"{count} models, {count - len(todo)} of them already trained.", STAGE))
    total, before = sum(run.config.steps for of_row in runs.values() for run in of_row if run.folder in todo), 0
    for i, submap in enumerate(submaps):
        views = SharedViews(project, submap)
        for row in rows:
            run = runs[row][i]
            if not run.is_done:
                title = f"{row.title}, submap {submap.index}"
                train_or_load(project, run, views.of(run), progress_of_run(listen, STAGE, before, total, title))
                before += run.config.steps
    return runs, len(todo)


def _evaluate_cell(
    model: str, criteria: Criteria, kept: StoredMap, occupancy: OccupancyMap, walk: Any, robot_radius: float, seen: Any
) -> ValidityCell:
    graph, report = kept.read()
    if graph is None:
        return ValidityCell(model, criteria, {}, None, str(report["why"]))
    figures = evaluate_graph(graph, occupancy, walk, robot_radius, seen=seen)
    return ValidityCell(model, criteria, {**figures, "seconds": report["seconds"]}, graph)


def _left_out(wanted: dict[Criteria, MappingConfig | None]) -> str:
    names = [" & ".join(criteria) for criteria, found in wanted.items() if found is None]
    if not names:
        return ""
    return f"Skipped: {', '.join(names)}; the map builder has no such criterion, or no network for it."
