"""Walk the trained models breadth-first and build the navigation graph with the evidence for every direction."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.session import working
from nvsim.mapping.config import MappingConfig
from nvsim.project.stages import mapped


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    reapply: bool = False
    """Decide the stored evidence again under these thresholds; render only what newly opens."""
    config: MappingConfig = field(default_factory=MappingConfig)


def run(arguments: Arguments) -> int:
    with working(arguments.project, "map", arguments.json) as (project, listen):
        mapped.run(project, arguments.config, listen, arguments.reapply)
    return 0
