"""Write trained submaps as splat files for other programs, each with its floor as a textured surface (glTF)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.console import listening
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    out: Path = Path("splats")
    """The output folder."""
    submaps: tuple[int, ...] = ()
    """Submaps to write. Default: all that are trained."""
    format: Literal["ply", "compressed-ply", "spz"] = "ply"
    """ply: exact, for every viewer. compressed-ply: SuperSplat's, at most a quarter of the size. spz: a tenth."""
    frame: Literal["aligned", "capture"] = "aligned"
    """The frame of the coordinates: the aligned frame (upright and metric), or the capture's own."""


def run(arguments: Arguments) -> int:

    from nvsim.project.stages.exported_splats import export_splats

    a = arguments
    with Project.open(a.project) as project, listening(False) as listen:
        written = export_splats(project, a.out, a.format, a.submaps, a.frame, listen)
    if a.json:
        say(as_json({"written": [str(p) for p in written]}))
    else:
        say(*(f"Wrote {p}" for p in written))
    return 0
