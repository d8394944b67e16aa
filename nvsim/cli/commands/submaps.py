"""Split the trajectory into overlapping submaps. Prints a table and draws pictures/submaps.png in the project."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

from nvsim.cli import show
from nvsim.cli.arguments import Inline, ProjectArguments
from nvsim.cli.session import working
from nvsim.project.stages import submaps
from nvsim.submaps.split import SubmapConfig, describe


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    config: Inline[SubmapConfig] = field(default_factory=SubmapConfig)


def run(arguments: Arguments) -> int:
    with working(arguments.project, "submaps", arguments.json) as (project, listen):
        result = submaps.run(project, arguments.config, listen)
        rows = describe(result, project.need_capture().positions)
    if not arguments.json:
        cells = [dataclasses.asdict(r) for r in rows]
        show.table(list(cells[0]), [[str(v) for v in c.values()] for c in cells], "submaps")
    return 0
