"""Compare the depth of the images with true depth: shares of pixels within 2, 5 and 10 percent, and covered share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.cli.arguments import ProjectArguments
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    truth: Path | None = None
    """Folder of 16-bit PNGs in millimeters along the optical axis, 0 if unknown, named like the frames or by their
    number (000000.png). Default: the built-in building's own."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.depth import evaluate_project_depth

    with Project.open(arguments.project) as project:
        result = evaluate_project_depth(project, arguments.truth)
    show.figures(result, arguments.json, "depth")
    return 0
