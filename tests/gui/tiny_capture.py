"""A capture of two small rooms that is imported, trained and mapped within seconds."""

from __future__ import annotations

import json
from pathlib import Path

from nvsim.building import BuildingConfig, generate
from nvsim.project.jobs.joblist import JobList

SETTINGS = {
    "submaps": {"config.count": 1},
    "train": {"config.steps": 60, "config.image_size": 96, "config.gaussian_cap": 3000, "config.threads": 1},
    "map": {"config.max_viewpoints": 6},
}


def write_capture(folder: Path) -> Path:
    """The folder of the capture; the truth lies beside it."""
    config = BuildingConfig(size="small", width=128, height=96, step=0.8, turn=40.0, people=False)
    generate(folder, config)
    return folder / "capture"


def write_settings(project: Path) -> None:
    """Settings that make every stage quick, as if a user had entered them in the forms."""
    (project / "settings.json").write_text(json.dumps(SETTINGS))


def states(project: Path) -> dict[str, str]:
    """Verb -> state of its last job."""
    return {j.order.verb: j.status.state for j in JobList(project).jobs()}
