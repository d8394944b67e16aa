"""The main job: every stage in order, each skipped where it is up to date, continued where it was cut off."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from nvsim.cluster.config import Storage
from nvsim.cluster.piece import Executor
from nvsim.events import Listener
from nvsim.project.config import CaptureConfig, DepthUse, RunConfig
from nvsim.project.floor_provider import choose
from nvsim.project.normals_used import check_normals
from nvsim.project.project import Project
from nvsim.project.stages import depths, floors, imported, mapped, submaps, trained
from nvsim.project.work import STAGES, StageName


def run(
    project: Project,
    source: Path,
    understood: CaptureConfig,
    config: RunConfig,
    listen: Listener,
    depth: DepthUse = "auto",
    executor: Executor | None = None,
    storage: Storage = "auto",
) -> None:
    """A posed walk in, a navigation graph in the project out; what comes in pieces is done by `executor`. Raises
    InputError for what a user can mend."""
    runs: dict[StageName, Callable[[], object]] = {
        "import": lambda: imported.run(project, source, understood, listen),
        "submaps": lambda: submaps.run(project, config.submaps, listen),
        "depth": lambda: depths.run(project, depth, config.depth, listen, executor, storage),
        "floors": lambda: floors.run(project, listen, False, config.floors, executor, storage),
        "train": lambda: trained.run(project, config.train, listen, executor=executor, storage=storage),
        "map": lambda: mapped.run(project, config.map, listen),
    }
    check_normals(config.map)  # before anything is made
    choose(config.floors, lambda: None)  # likewise: a network that is named and not there
    for stage in STAGES:
        runs[stage]()
        if stage == "import" and config.map.start:
            mapped.start_of(project.need_capture(), config.map.start)  # refused now, not after the training
