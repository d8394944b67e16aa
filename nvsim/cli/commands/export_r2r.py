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
    """The output folder. Scans of other projects in its scans.txt are kept."""
    scan: str | None = None
    """The scan id. Default: the project's name in letters and digits."""
    frame: Literal["aligned", "capture"] = "aligned"
    """The frame of the poses: the project's aligned frame, or the capture's own (only if that is upright too)."""
    force: bool = False
    """Also write graphs that R2R agents cannot handle."""


def run(arguments: Arguments) -> int:
    from nvsim.project.stages.exported import export_r2r

    with Project.open(arguments.project) as project:
        written = export_r2r(project, arguments.out, arguments.scan, arguments.frame, arguments.force)
    say(as_json({"written": str(written)}) if arguments.json else f"Wrote {written}")
    return 0
