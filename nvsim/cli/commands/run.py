"""A posed walk in, an R2R navigation graph out: every stage in order, each resumed where it was cut off."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.session import working
from nvsim.project import pipeline
from nvsim.project.config import RunConfig


@dataclass(frozen=True)
class Arguments:
    capture: Positional[Path]
    """A folder or file: nerfstudio transforms.json, COLMAP, or kapture."""
    project: Path
    """The project folder to make or to go on with."""
    scale: float | None = None
    """Metres per unit of the capture, when it does not know."""
    camera_height: float | None = None
    """Metres of the cameras above the floor: gives the scale of a capture that has none."""
    json: bool = False
    """Print typed events as JSON lines."""
    config: RunConfig = field(default_factory=RunConfig)


def run(arguments: Arguments) -> int:
    from dataclasses import replace

    config = arguments.config
    capture = replace(
        config.capture,
        scale=arguments.scale or config.capture.scale,
        camera_height=arguments.camera_height or config.capture.camera_height,
    )
    with working(arguments.project, "run", arguments.json, create=True) as (project, listen):
        pipeline.run(project, arguments.capture, replace(config, capture=capture), listen)
    return 0
