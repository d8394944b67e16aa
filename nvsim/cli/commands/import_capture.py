"""Read a capture into a project: frames, lenses, poses and cloud, turned upright; images stay where they are."""

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
    """The project folder to make or to write to."""
    add: bool = False
    """Leave what the project holds and import this capture beside it: same building, same world, same unit."""
    json: bool = False
    """Print typed events as JSON lines."""
    understood: Inline[CaptureConfig] = field(default_factory=CaptureConfig)


def run(arguments: Arguments) -> int:
    with working(arguments.project, "import", arguments.json, create=not arguments.add) as (project, listen):
        if arguments.add:
            leave_out = arguments.understood.leave_out
            if arguments.understood != CaptureConfig(leave_out=leave_out):
                raise InputError(
                    "An added capture takes the scale and the held-out frames of the first; leave out --scale, "
                    "--camera-height, --known-length, --hold-out, --images, --axes, --poses, --views and --mask. "
                    "Instead of --model, name the model's folder."
                )
            added.run(project, arguments.capture, listen, leave_out)
        else:
            imported.run(project, arguments.capture, arguments.understood, listen)
    return 0
