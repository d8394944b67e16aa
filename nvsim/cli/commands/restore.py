"""Restore the earlier result of a stage, or undo such a restore. Without a stage, list the stored results."""

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
from nvsim.project.earlier_results import discard, kept_results, megabytes, restore
from nvsim.project.project import Project
from nvsim.project.work import StageName


@dataclass(frozen=True)
class Arguments:
    project: Path
    """The project folder."""
    stage: Positional[Literal["", StageName]] = ""
    """The stage whose earlier result is restored. Results of later stages are not changed."""
    discard: bool = False
    """Delete the stored result to free disk space. The result in use is kept."""
    json: bool = False
    """Print events as JSON lines, or the list as JSON."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if the stage is missing or has no stored result."""
    if not arguments.stage:
        return _list(arguments)
    with working(arguments.project, "restore", arguments.json) as (project, listen):
        if arguments.discard:
            freed = discard(project, arguments.stage)
            listen(Done("restore", f"earlier result of {arguments.stage} deleted, {megabytes(freed)} freed", {}))
        else:
            words = restore(project, arguments.stage)
            listen(Done("restore", f"{words} in use again; run the command again to undo this", {}))
    return 0


def _list(arguments: Arguments) -> int:
    if arguments.discard:
        raise InputError("Name the stage whose earlier result to discard: nvsim restore STAGE --discard.")
    with Project.open(arguments.project) as project:
        kept = kept_results(project)
    if arguments.json:
        say(show.as_json([asdict(k) for k in kept]))
    elif kept:
        show.table(
            ["stage", "earlier result", "size"], [[k.stage, k.words, megabytes(k.bytes)] for k in kept], "results"
        )
    else:
        say("There is no earlier result yet; a stage stores one when it runs again.")
    return 0
