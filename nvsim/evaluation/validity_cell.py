"""One map of the table of validities, stored in a folder that is named by a hash of its inputs.

P/validity/KEY/cell.json    after the build: the inputs and the builder's report, or the reason why there is no map
P/validity/KEY/graph.zip    the graph with its evidence
P/validity/KEY/measured.zip all evidence that it was built from, for other criteria
P/validity/KEY/partial.zip  evidence during the build; the project's own graph is never changed
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nvsim import __version__
from nvsim.errors import InputError
from nvsim.evaluation.ablation_run import Run
from nvsim.events import Listener
from nvsim.files import atomic
from nvsim.files.regular import read_bytes, read_json
from nvsim.graph.store import decode_graph, encode_graph
from nvsim.graph.types import NavGraph
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.small_graph import NoViewpointFound
from nvsim.project import ledger
from nvsim.project.corrections import corrections_key
from nvsim.project.project import Project
from nvsim.project.stages.floors import supporting_frames

_VERSION = 1  # to be raised if the same models, thresholds, and release would give another map


@dataclass(frozen=True)
class Kept:
    """The files of one stored map."""

    folder: Path

    @property
    def done(self) -> Path:
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
        return self.done.is_file()

    def read(self) -> tuple[NavGraph | None, dict[str, Any]]:
        """The graph and its report. The graph is None if there was no free place. Raises InputError if a file is
        damaged."""
        again = "delete the folder and run the command again"
        said = read_json(self.done, "the report of a map", again)
        report = said.get("report") if isinstance(said, dict) else None
        if not isinstance(report, dict) or not ("seconds" in report or "why" in report):
            raise InputError(f"{self.done} is not the report of a map; {again}.")
        return (None if "why" in report else decode_graph(read_bytes(self.graph))), report


def cells_folder(project: Project) -> Path:
    return project.layout.root / "validity"


def kept_cell(project: Project, runs: Sequence[Run], config: MappingConfig) -> Kept:
    """The folder of the map that these models, one per submap, give with `config`."""
    corrected = corrections_key(project, supporting_frames(project))
    program = (__version__, _VERSION)
    key = ledger.key_of("validity", program, [run.folder.name for run in runs], config, *corrected)
    return Kept(cells_folder(project) / key)


def made_cell(
    project: Project,
    runs: Sequence[Run],
    config: MappingConfig,
    kept: Kept,
    known: Sequence[Kept],
    listen: Listener,
) -> None:
    """Builds the map, and continues an interrupted build. Measurements in the `known` maps of the same models are
    reused. Raises InputError if the disk refuses."""
    from nvsim.mapping.builder import build_map
    from nvsim.project.floor_heights import floor_of
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
            support.at,
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
    atomic.write_text(kept.done, json.dumps(said, indent=1) + "\n")
    kept.partial.unlink(missing_ok=True)
