"""Train the floor-aware Gaussian model of each submap. An interrupted training continues from its checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import tyro

from nvsim.cli.arguments import Inline, ProjectArguments, given
from nvsim.cli.session import working
from nvsim.cluster.choice import opened
from nvsim.cluster.config import ClusterConfig
from nvsim.project.stages import trained
from nvsim.training.config import Preset, TrainingConfig, at_paper_scale, preset


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    submaps: tuple[int, ...] = ()
    """Submaps to train. Default: all."""
    at_once: int = 0
    """Number of submaps to train in parallel, each with its share of the cores; 0 decides by cores and free memory."""
    preset: Preset = "nvsim"
    """The values that the other options start from: NVSim's defaults, the paper's, or those of one of its baselines."""
    paper_scale: bool = False
    """Train models as large as the paper's: 30,000 steps, images of full size, a million Gaussians per submap, networks
    of full size. Needs a CUDA GPU to finish within a day."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[TrainingConfig] = field(default_factory=TrainingConfig)


def defaults(argv: list[str]) -> Arguments:
    name = given(argv, "--preset", "nvsim")
    config = at_paper_scale(preset(name)) if "--paper-scale" in argv else preset(name)
    return Arguments(cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)


def run(arguments: Arguments) -> int:
    cluster = arguments.cluster
    with opened(cluster) as executor, working(arguments.project, "train", arguments.json) as (project, listen):
        trained.run(project, arguments.config, listen, arguments.submaps, arguments.at_once, executor, cluster.storage)
    return 0
