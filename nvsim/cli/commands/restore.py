"""Go back to what a stage made before its last run, or forth again. Without a stage, list what is kept."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli import show
from nvsim.cli.arguments import Positional
from nvsim.cli.session import working
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.events import Done
from nvsim.project.project import Project
from nvsim.project.restored import discard, kept_results, megabytes, restore
from nvsim.project.work import StageName


@dataclass(frozen=True)
class Arguments:
    project: Path
    """The project folder."""
    stage: Positional[Literal["", StageName]] = ""
    """Whose result to put back; the stages after it stay as they are."""
    discard: bool = False
    """Let go of what is kept, to free the disk; what is in use stays."""
    json: bool = False
    """Print typed events as JSON lines, or the list as JSON."""


def run(arguments: Arguments) -> int:
    if not arguments.stage:
        return _list(arguments)
    with working(arguments.project, "restore", arguments.json) as (project, listen):
        if arguments.discard:
            freed = discard(project, arguments.stage)
            listen(Done("restore", f"the earlier result of {arguments.stage} is gone, {megabytes(freed)} are free", {}))
        else:
            words = restore(project, arguments.stage)
            listen(Done("restore", f"{words} in use again; the same command goes back", {}))
    return 0


def _list(arguments: Arguments) -> int:
    if arguments.discard:
        raise InputError("Say which stage's earlier result to discard: nvsim restore STAGE --discard.")
    with Project.open(arguments.project) as project:
        kept = kept_results(project)
    if arguments.json:
        say(show.as_json([asdict(k) for k in kept]))
    elif kept:
        show.table(["stage", "earlier result", "size"], [[k.stage, k.words, megabytes(k.bytes)] for k in kept], "kept")
    else:
        say("There is no earlier result yet; a stage that runs again leaves one.")
    return 0
