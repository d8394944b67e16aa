"""How near the depth of the images comes to a true one: shares within 2, 5 and 10 per cent, and of what is covered."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.cli.arguments import ProjectArguments
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    truth: Path | None = None
    """Folder of PNGs of 16 bits, millimetres along the optical axis, 0 where unknown, named like the frames or by their
    number (000000.png); the built-in building's own when left out."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.depth import evaluate_project_depth

    with Project.open(arguments.project) as project:
        result = evaluate_project_depth(project, arguments.truth)
    show.figures(result, arguments.json, "depth")
    return 0
