"""Mean IoU of the project's floor masks against true masks, over frames with at least 1 % true floor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.cli.arguments import ProjectArguments
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    truth: Path | None = None
    """Folder with floor/ masks named like the frames; the built-in building's own when left out."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.truth import evaluate_project_floor

    with Project.open(arguments.project) as project:
        result = evaluate_project_floor(project, arguments.truth)
    show.figures(result, arguments.json, "floor masks")
    return 0
