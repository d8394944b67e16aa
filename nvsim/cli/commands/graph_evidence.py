"""Measure the evidence of viewpoints that were added or moved, and propose or question edges there.

Without --graph, the project's own graph is used, and the evidence is stored in it. With --graph, a graph file written
by the window, the project is not changed and the result is written to --out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from nvsim.cli.arguments import Inline, Memory, ProjectArguments, memory_budget
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.mapping.config import MappingConfig

if TYPE_CHECKING:
    from nvsim.events import Listener
    from nvsim.graph.types import NavGraph
    from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    viewpoints: tuple[str, ...] = ()
    """Ids of viewpoints. Default: all that a user added or moved and that were not measured since."""
    graph: Path | None = None
    """A graph file to read instead of the project's graph."""
    out: Path | None = None
    """File for the graph with its new evidence; required with --graph."""
    memory: Memory = None
    """GiB of memory for trained models. Default: a quarter of the machine's memory."""
    config: Inline[MappingConfig] = field(default_factory=MappingConfig)


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if only one of --graph and --out is given."""
    from nvsim.cli.console import listening
    from nvsim.cli.session import working
    from nvsim.project.project import Project

    if (arguments.graph is None) != (arguments.out is None):
        raise InputError("A graph file is read and written: give --graph and --out together, or neither.")
    if arguments.graph is not None and arguments.out is not None:
        from nvsim.files.atomic import write_bytes
        from nvsim.files.regular import read_bytes
        from nvsim.graph.store import decode_graph, encode_graph

        blob = read_bytes(arguments.graph)
        with Project.open(arguments.project) as project, listening(arguments.json) as listen:
            write_bytes(arguments.out, encode_graph(_measured(arguments, project, decode_graph(blob), listen)))
        return 0
    with working(arguments.project, "evidence", arguments.json) as (project, listen):
        project.set_graph(_measured(arguments, project, project.need_graph(), listen))
    return 0


def _measured(arguments: Arguments, project: Project, graph: NavGraph, listen: Listener) -> NavGraph:
    from nvsim.events import Done
    from nvsim.mapping.new_viewpoint_evidence import STAGE, with_new_viewpoints
    from nvsim.project.stages.measured import measure, unmeasured

    ids = arguments.viewpoints or tuple(unmeasured(graph))
    found = measure(project, graph, ids, arguments.config, listen, memory_budget(arguments.memory))
    words = f"{len(ids)} viewpoints measured, {len(found.proposed)} edges proposed, {len(found.doubted)} doubted"
    listen(Done(STAGE, words, {"proposed": list(found.proposed), "doubted": list(found.doubted)}))
    if not arguments.json:
        say(as_json({"proposed": found.proposed, "doubted": found.doubted}))
    return with_new_viewpoints(graph, found)
