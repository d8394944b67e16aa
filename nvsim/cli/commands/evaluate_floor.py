"""Measure the mean IoU of the project's floor masks with true masks, over frames with at least 1 % true floor. Also
measures the semantic network, the normals network, and their hybrid alone (iou_semantic, iou_normals, iou_hybrid, and
iou_masks for the project's masks on the frames used)."""

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
    """Folder with floor/ masks named like the frames. Default: the built-in building's own."""
    from_scan: bool = False
    """Use labels from the project's own point cloud as ground truth. Pixels without a label do not count."""
    cues: int = 48
    """Number of frames, evenly spread over the trajectory, on which each cue is measured; 0 for none."""
    semantic: str = BUNDLED
    """The semantic network among the cues."""
    normals: str = BUNDLED
    """The normals network among the cues."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --cues is negative."""
    from nvsim.cli.console import listening
    from nvsim.errors import InputError
    from nvsim.evaluation.floor_cues import evaluate_project_floor

    a = arguments
    if a.cues < 0:
        raise InputError(f"--cues {a.cues} is not a number of frames; give 0 or more.")
    with Project.open(a.project) as project, listening(False) as listen:
        result = evaluate_project_floor(project, a.truth, a.from_scan, a.cues, a.semantic, a.normals, listen)
    show.figures(result, a.json, "floor masks")
    return 0
