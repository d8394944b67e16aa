"""PSNR and SSIM of the frames that were held out of training, at full size, with and without the floor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.console import listening
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    truth: Path | None = None
    """Folder with floor/ (and transient/) masks named like the frames; the project's own masks when left out."""
    pictures: Path | None = None
    """Folder for side-by-side pictures: frame, render, alpha."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.views import evaluate_views

    with Project.open(arguments.project) as project, listening(False) as listen:
        result = evaluate_views(project, arguments.truth, arguments.pictures, listen)
    show.figures(result, arguments.json, "held-out frames")
    return 0
