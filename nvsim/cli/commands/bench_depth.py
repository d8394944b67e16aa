"""Milliseconds of the depth of a frame, on a walk through the built-in building made in memory."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.cli import show
from nvsim.cli.arguments import Inline
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    frames: int = 12
    """Images of the walk; their depth is estimated, confirmed by each other, and fused."""
    json: bool = False
    """Print one JSON object."""
    config: Inline[DepthConfig] = field(default_factory=DepthConfig)


def run(arguments: Arguments) -> int:
    from nvsim.benchmarks.depth import measure

    if not 2 <= arguments.frames <= 1000:
        raise InputError(f"--frames {arguments.frames} makes no walk; say 2 to 1000.")
    show.figures(measure(arguments.frames, arguments.config), arguments.json, "depth")
    return 0
