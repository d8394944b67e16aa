"""The main job: every stage in order, each skipped where it is up to date, continued where it was cut off."""

from __future__ import annotations

from pathlib import Path

from nvsim.events import Listener
from nvsim.project.config import CaptureConfig, RunConfig
from nvsim.project.project import Project
from nvsim.project.stages import floors, imported, mapped, submaps, trained


def run(project: Project, source: Path, understood: CaptureConfig, config: RunConfig, listen: Listener) -> None:
    """A posed walk in, a navigation graph in the project out. Raises InputError for what a user can mend."""
    imported.run(project, source, understood, listen)
    submaps.run(project, config.submaps, listen)
    floors.run(project, listen)
    trained.run(project, config.train, listen)
    mapped.run(project, config.map, listen)
