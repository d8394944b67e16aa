"""Runs the main job: every stage in order. Stages that are current are skipped, and interrupted stages continue."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from nvsim.cluster.piece import Executor
from nvsim.events import Listener, ignore_event
from nvsim.project.config import CaptureConfig, DepthUse, RunConfig
from nvsim.project.floor_provider import choose
from nvsim.project.project import Project
from nvsim.project.stages import depths, floors, imported, imported_splats, mapped, submaps, trained
from nvsim.project.work import SPLAT_STAGES, STAGES, StageName


def run(
    project: Project,
    source: Path,
    capture_config: CaptureConfig,
    config: RunConfig,
    listen: Listener = ignore_event,
    depth: DepthUse = "auto",
    executor: Executor | None = None,
) -> None:
    """Builds a navigation graph in the project from the capture or video `source`. `executor` runs work that is divided
    into pieces. Raises InputError for errors that the user can fix."""
    runs: dict[StageName, Callable[[], object]] = {
        "import": lambda: imported.run(project, source, capture_config, listen),
        "submaps": lambda: submaps.run(project, config.submaps, listen),
        "depth": lambda: depths.run(project, depth, config.depth, listen, executor),
        "floors": lambda: floors.run(project, listen, False, config.floors, executor),
        "train": lambda: trained.run(project, config.train, listen, executor=executor),
        "map": lambda: mapped.run(project, config.map, listen),
    }
    mapped.check_normals(config.map)  # before any stage runs
    choose(config.floors, lambda: None)  # raises early if a named network is missing
    for stage in SPLAT_STAGES if imported_splats.is_splats(source) else STAGES:
        runs[stage]()
        if stage == "import" and config.map.start:
            mapped.search_start(project.need_capture(), config.map.start)  # raises before the training starts
