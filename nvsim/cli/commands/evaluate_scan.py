"""Check an exported scan: files, directions of the faces, reachable edges, seams, and views from its strips."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    folder: Positional[Path]
    """The folder written by `nvsim export scan`."""
    scan: str | None = None
    """The scan to check, if the folder has several scans of NVSim."""
    project: Path | None = None
    """The project that it was exported from. Views are also rendered directly, and compared with those from strips."""
    views: int = 400
    """Number of views to compare."""
    json: bool = False
    """Print the results as JSON."""


def run(arguments: Arguments) -> int:
    """Returns 1 if the scan has problems. Raises InputError if --views is out of range."""
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
        say(*(result["problems"] or ["No problems found."]))
    return 1 if result["problems"] else 0
