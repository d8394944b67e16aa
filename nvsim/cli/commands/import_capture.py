"""Read a capture into a project: frames, cameras, poses and point cloud, rotated upright. Images are not copied."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline
from nvsim.cli.capture_argument import CapturePath
from nvsim.cli.session import working
from nvsim.errors import InputError
from nvsim.project.config import CaptureConfig
from nvsim.project.stages import added, imported


@dataclass(frozen=True)
class Arguments:
    capture: CapturePath
    project: Path
    """The project folder to create or to write to."""
    add: bool = False
    """Keep the project's captures and add this one, which must show the same building in the same frame and unit."""
    json: bool = False
    """Print events as JSON lines."""
    understood: Inline[CaptureConfig] = field(default_factory=CaptureConfig)


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if options contradict --add."""
    with working(arguments.project, "import", arguments.json, create=not arguments.add) as (project, listen):
        if arguments.add:
            leave_out = arguments.understood.leave_out
            if arguments.understood != CaptureConfig(leave_out=leave_out):
                raise InputError(
                    "An added capture has the scale and the held-out frames of the first; do not give --scale, "
                    "--camera-height, --known-length, --hold-out, --images, --axes, --poses, --views and --mask. "
                    "Instead of --model, name the model's folder."
                )
            added.run(project, arguments.capture, listen, leave_out)
        else:
            imported.run(project, arguments.capture, arguments.understood, listen)
    return 0
