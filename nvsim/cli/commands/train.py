"""Fit the floor-aware Gaussian model of each submap; a run that was cut off goes on from its checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.session import working
from nvsim.project.stages import trained
from nvsim.training.config import TrainingConfig


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    submaps: tuple[int, ...] = ()
    """Which submaps to train; all when none is named."""
    config: TrainingConfig = field(default_factory=TrainingConfig)


def run(arguments: Arguments) -> int:
    with working(arguments.project, "train", arguments.json) as (project, listen):
        trained.run(project, arguments.config, listen, arguments.submaps)
    return 0
