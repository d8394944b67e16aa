"""Write the navigation graph as R2R connectivity and scans.txt, which existing agents load unchanged."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    out: Path = Path("connectivity")
    """The folder to write to; scans of other projects in its scans.txt stay."""
    scan: str | None = None
    """The scan id; the project's name in letters and digits when left out."""
    frame: Literal["aligned", "capture"] = "aligned"
    """The frame of the poses: upright, or the capture's own (only where that is upright too)."""
    force: bool = False
    """Write what R2R agents would choke on as well."""


def run(arguments: Arguments) -> int:
    from nvsim.project.stages.exported import export_r2r

    with Project.open(arguments.project) as project:
        written = export_r2r(project, arguments.out, arguments.scan, arguments.frame, arguments.force)
    say(as_json({"written": str(written)}) if arguments.json else f"Wrote {written}")
    return 0
