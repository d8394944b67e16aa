"""Check an exported scan: files, directions of the faces, reach of the edges, seams, and views from its strips."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    folder: Positional[Path]
    """The folder of `nvsim export scan`."""
    scan: str | None = None
    """Which scan, where the folder holds several of ours."""
    project: Path | None = None
    """The project it was exported from: views are drawn directly too, and compared with those from the strips."""
    views: int = 400
    """How many views are compared."""
    json: bool = False
    """Print the figures as JSON."""


def run(arguments: Arguments) -> int:
    """1 where something is wrong with the scan."""
    from contextlib import nullcontext

    from nvsim.cli import show
    from nvsim.cli.console import listening
    from nvsim.errors import InputError
    from nvsim.evaluation.scan import evaluate_scan
    from nvsim.project.project import Project

    a = arguments
    if not 1 <= a.views <= 100_000:
        raise InputError(f"{a.views} views cannot be compared; give --views from 1 to 100,000.")
    opened = nullcontext() if a.project is None else Project.open(a.project)
    with opened as project, listening(False) as listen:
        result = evaluate_scan(a.folder, a.scan, project, a.views, listen)
    show.figures(result, a.json, "scan")
    if not a.json:
        say(*(result["problems"] or ["All is well."]))
    return 1 if result["problems"] else 0
