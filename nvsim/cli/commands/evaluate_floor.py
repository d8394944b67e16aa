"""Mean IoU of the project's floor masks against true masks, over frames with at least 1 % true floor, and what networks
of looks, of normals and their hybrid would give alone (iou_semantic, iou_normals, iou_hybrid beside iou_masks)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.cli.arguments import ProjectArguments
from nvsim.networks.installed import BUNDLED
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    truth: Path | None = None
    """Folder with floor/ masks named like the frames; the built-in building's own when left out."""
    from_scan: bool = False
    """True is what the project's own scan says for certain; pixels that it does not know do not count."""
    cues: int = 48
    """Of how many frames, spread over the walk, each cue is scored too; 0 for none."""
    semantic: str = BUNDLED
    """The network of looks among the cues."""
    normals: str = BUNDLED
    """The network of normals among them."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.console import listening
    from nvsim.errors import InputError
    from nvsim.evaluation.floor_cues import evaluate_project_floor

    a = arguments
    if a.cues < 0:
        raise InputError(f"--cues {a.cues} is no number of frames; say 0 or more.")
    with Project.open(a.project) as project, listening(False) as listen:
        result = evaluate_project_floor(project, a.truth, a.from_scan, a.cues, a.semantic, a.normals, listen)
    show.figures(result, a.json, "floor masks")
    return 0
