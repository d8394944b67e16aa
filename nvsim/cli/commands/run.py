"""A posed walk in, an R2R navigation graph out: every stage in order, each resumed where it was cut off."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import tyro

from nvsim.cli.arguments import Inline, given
from nvsim.cli.capture_argument import CapturePath
from nvsim.cli.session import working
from nvsim.project import pipeline
from nvsim.project.config import CaptureConfig, DepthUse, RunConfig
from nvsim.training.config import Preset, preset


@dataclass(frozen=True)
class Arguments:
    capture: CapturePath
    project: Path
    """The project folder to make or to go on with."""
    json: bool = False
    """Print typed events as JSON lines."""
    understood: Inline[CaptureConfig] = field(default_factory=CaptureConfig)
    preset: Preset = "nvsim"
    """What the flags of training start from."""
    depth: DepthUse = "auto"
    """Whether depth is estimated from the images: where the capture has no scan, always, or never."""
    config: Inline[RunConfig] = field(default_factory=RunConfig)


def defaults(argv: list[str]) -> Arguments:
    name = given(argv, "--preset", "nvsim")
    config = RunConfig(train=preset(name))
    return Arguments(cast(Path, tyro.MISSING), cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)


def run(arguments: Arguments) -> int:
    with working(arguments.project, "run", arguments.json, create=True) as (project, listen):
        pipeline.run(project, arguments.capture, arguments.understood, arguments.config, listen, arguments.depth)
    return 0
