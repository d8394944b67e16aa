"""Measure the milliseconds of the depth of a frame, on a trajectory through the built-in building, made in memory."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.cli import show
from nvsim.cli.arguments import Inline
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    frames: int = 12
    """Number of images. Their depth is estimated, checked against other images, and fused."""
    json: bool = False
    """Print one JSON object."""
    config: Inline[DepthConfig] = field(default_factory=DepthConfig)


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --frames is out of range."""
    from nvsim.benchmarks.depth import measure

    if not 2 <= arguments.frames <= 1000:
        raise InputError(f"--frames {arguments.frames} is out of range; give 2 to 1000.")
    show.figures(measure(arguments.frames, arguments.config), arguments.json, "depth")
    return 0
