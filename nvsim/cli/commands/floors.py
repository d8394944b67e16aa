"""Find the floor in every frame: floor heights, a mask per frame, and the floor area that all masks support."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.cli.arguments import Inline, ProjectArguments
from nvsim.cli.session import working
from nvsim.cluster.choice import opened
from nvsim.cluster.config import ClusterConfig
from nvsim.project.config import FloorsConfig
from nvsim.project.stages import floors


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    discard_corrections: bool = False
    """Discard masks that were corrected by hand. Without this option they are kept and take precedence."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[FloorsConfig] = field(default_factory=FloorsConfig)


def run(arguments: Arguments) -> int:
    cluster = arguments.cluster
    with opened(cluster) as executor, working(arguments.project, "floors", arguments.json) as (project, listen):
        floors.run(project, listen, arguments.discard_corrections, arguments.config, executor, cluster.storage)
    return 0
