"""Read a capture into a project: frames, lenses, poses and cloud, turned upright; images stay where they are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.session import working
from nvsim.project.config import CaptureConfig
from nvsim.project.stages import imported


@dataclass(frozen=True)
class Arguments:
    capture: Positional[Path]
    """A folder or file: nerfstudio transforms.json, COLMAP, or kapture."""
    project: Path
    """The project folder to make or to write to."""
    scale: float | None = None
    """Metres per unit of the capture, when it does not know."""
    camera_height: float | None = None
    """Metres of the cameras above the floor: gives the scale of a capture that has none."""
    hold_out: int = 8
    """Every how many frames one is kept out of training, for evaluation; 0 keeps none out."""
    json: bool = False
    """Print typed events as JSON lines."""


def run(arguments: Arguments) -> int:
    config = CaptureConfig(arguments.scale, arguments.camera_height, arguments.hold_out)
    with working(arguments.project, "import", arguments.json, create=True) as (project, listen):
        imported.run(project, arguments.capture, config, listen)
    return 0
