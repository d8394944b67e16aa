"""Fit the floor-aware Gaussian model of each submap; a run that was cut off goes on from its checkpoint."""

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
from nvsim.training.config import Preset, TrainingConfig, preset


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    submaps: tuple[int, ...] = ()
    """Which submaps to train; all when none is named."""
    at_once: int = 0
    """How many submaps to train at a time, each with its share of the cores; 0 decides by cores and free memory."""
    preset: Preset = "nvsim"
    """What the other flags start from: our defaults, the paper's, or those of one of its baselines."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[TrainingConfig] = field(default_factory=TrainingConfig)


def defaults(argv: list[str]) -> Arguments:
    name = given(argv, "--preset", "nvsim")
    return Arguments(cast(Path, tyro.MISSING), preset=cast(Any, name), config=preset(name))


def run(arguments: Arguments) -> int:
    cluster = arguments.cluster
    with opened(cluster) as executor, working(arguments.project, "train", arguments.json) as (project, listen):
        trained.run(project, arguments.config, listen, arguments.submaps, arguments.at_once, executor, cluster.storage)
    return 0
