"""Read a capture into a project: frames, lenses, poses and cloud, turned upright; images stay where they are."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.session import working
from nvsim.project.config import CaptureConfig
from nvsim.project.stages import imported


@dataclass(frozen=True)
class Arguments:
    capture: Positional[Path]
    """A folder or file: nerfstudio transforms.json, COLMAP, or kapture."""
    project: Path
    """The project folder to make or to write to."""
    json: bool = False
    """Print typed events as JSON lines."""
    understood: Inline[CaptureConfig] = field(default_factory=CaptureConfig)


def run(arguments: Arguments) -> int:
    with working(arguments.project, "import", arguments.json, create=True) as (project, listen):
        imported.run(project, arguments.capture, arguments.understood, listen)
    return 0
