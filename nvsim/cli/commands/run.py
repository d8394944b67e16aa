"""A posed walk in, an R2R navigation graph out: every stage in order, each resumed where it was cut off."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import tyro

from nvsim.cli.arguments import Inline, given
from nvsim.cli.capture_argument import CapturePath
from nvsim.cli.normal_source import asked, papers, say_if_it_falls_back
from nvsim.cli.session import working
from nvsim.cluster.choice import opened
from nvsim.cluster.config import ClusterConfig
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NormalSource
from nvsim.project import pipeline
from nvsim.project.config import CaptureConfig, DepthUse, RunConfig
from nvsim.training.config import Device, Preset, at_paper_scale, preset
from nvsim.training.devices.choice import card


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
    paper_scale: bool = False
    """Models as large as the paper's: 30,000 steps, images of full size, a million Gaussians in a submap, networks of
    full size. Needs a CUDA card to end within the day."""
    device: Device = "auto"
    """Where Gaussians are trained: on a CUDA card by gsplat, on the CPU, or auto for the card where there is one."""
    paper: bool = False
    """The paper's model and the paper's map: the presets splatfacto-i of training and paper of the map."""
    normal_source: NormalSource = "criteria"
    """Whose upward normals the map asks: the Gaussians', those that a network sees in the rendered views, or both;
    criteria leaves it to --map.criteria."""
    depth: DepthUse = "auto"
    """Whether depth is estimated from the images: where the capture has no scan, always, or never."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[RunConfig] = field(default_factory=RunConfig)


def defaults(argv: list[str]) -> Arguments:
    paper = "--paper" in argv
    name = given(argv, "--preset", "splatfacto-i" if paper else "nvsim")
    train = at_paper_scale(preset(name)) if "--paper-scale" in argv else preset(name)
    config = RunConfig(train=train, map=papers() if paper else MappingConfig())
    return Arguments(cast(Path, tyro.MISSING), cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)


def run(arguments: Arguments) -> int:
    config = replace(arguments.config, map=asked(arguments.config.map, arguments.normal_source))
    if arguments.device != "auto":
        config = replace(config, train=replace(config.train, device=arguments.device))
    if arguments.cluster.executor == "local":
        card(config.train.device)  # refused before anything is imported
    cluster = arguments.cluster
    with (
        opened(cluster) as executor,
        working(arguments.project, "run", arguments.json, create=True) as (project, listen),
    ):
        if arguments.paper:
            say_if_it_falls_back(config.map, arguments.normal_source, listen)
        pipeline.run(
            project,
            arguments.capture,
            arguments.understood,
            config,
            listen,
            arguments.depth,
            executor,
            cluster.storage,
        )
    return 0
