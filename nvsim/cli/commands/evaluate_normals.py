"""Mean angle between a network's normals and the true ones, on photographs or on renders of the project's models."""

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
    """Folder with floor/ and normals/ named like the frames, normals as (n + 1) * 127.5 in the world, black where
    unknown; the built-in building's own when left out."""
    from_scan: bool = False
    """True is what the project's own scan says for certain."""
    of: Literal["photographs", "renders"] = "photographs"
    """Renders are made from the cameras of the frames."""
    normals: str = BUNDLED
    """The network: a model's name (nvsim models)."""
    frames: int = 60
    """At most so many, spread over the walk."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.console import listening
    from nvsim.errors import InputError
    from nvsim.evaluation.normals import evaluate_project_normals

    a = arguments
    if a.frames < 1:
        raise InputError(f"--frames {a.frames} is too little; say 1 or more.")
    with Project.open(a.project) as project, listening(False) as listen:
        result = evaluate_project_normals(project, a.normals, a.of, a.truth, a.from_scan, a.frames, listen)
    show.figures(result, a.json, "normals")
    return 0
