"""Find the floor in every frame: floor heights, a mask per frame, and the floor that they support together."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.session import working
from nvsim.project.stages import floors


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    pass


def run(arguments: Arguments) -> int:
    with working(arguments.project, "floors", arguments.json) as (project, listen):
        floors.run(project, listen)
    return 0
