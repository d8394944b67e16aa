"""Build an R2R navigation graph from images of a building: run every stage in order, and continue interrupted ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import tyro

from nvsim.cli.arguments import Inline, given
from nvsim.cli.capture_argument import CapturePath
from nvsim.cli.normal_source import asked, papers, say_if_it_falls_back
from nvsim.cli.session import working
from nvsim.cli.summary import summary
from nvsim.cli.terminal import say
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
    """The project folder to create or to continue."""
    json: bool = False
    """Print events as JSON lines."""
    understood: Inline[CaptureConfig] = field(default_factory=CaptureConfig)
    preset: Preset = "nvsim"
    """The preset that the training options start from."""
    paper_scale: bool = False
    """Train models as large as the paper's: 30,000 steps, images of full size, a million Gaussians per submap, networks
    of full size. Needs a CUDA GPU to finish within a day."""
    device: Device = "auto"
    """Device of the training: a CUDA GPU with gsplat, the CPU, or auto for a GPU if there is one."""
    paper: bool = False
    """Use the paper's model and map: the preset splatfacto-i for training, and paper for the map."""
    normal_source: NormalSource = "criteria"
    """Upward normals that the map tests: the Gaussians', those that a network estimates from the rendered views, or
    both. criteria: as in --map.criteria."""
    depth: DepthUse = "auto"
    """When to estimate depth from the images: auto (if the capture has no scan), always, or never."""
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
        card(config.train.device)  # raises an error before anything is imported
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
        end = [] if arguments.json else summary(project)
    say(*end)
    return 0
