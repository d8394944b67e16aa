"""Measure the mean angle between a network's normals and the true normals, on photographs or on renders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli import show
from nvsim.cli.arguments import ProjectArguments
from nvsim.networks.installed import BUNDLED
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    truth: Path | None = None
    """Folder with floor/ and normals/ named like the frames, normals as (n + 1) * 127.5 in the world, black if unknown.
    Default: the built-in building's own."""
    from_scan: bool = False
    """Use labels from the project's own point cloud as ground truth."""
    of: Literal["photographs", "renders"] = "photographs"
    """Images to use. Renders are made from the cameras of the frames."""
    normals: str = BUNDLED
    """The network: a model's name (see nvsim models)."""
    frames: int = 60
    """Largest number of frames, evenly spread over the trajectory."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --frames is not positive."""
    from nvsim.cli.console import listening
    from nvsim.errors import InputError
    from nvsim.evaluation.normals import evaluate_project_normals

    a = arguments
    if a.frames < 1:
        raise InputError(f"--frames {a.frames} is out of range; give 1 or more.")
    with Project.open(a.project) as project, listening(False) as listen:
        result = evaluate_project_normals(project, a.normals, a.of, a.truth, a.from_scan, a.frames, listen)
    show.figures(result, a.json, "normals")
    return 0
