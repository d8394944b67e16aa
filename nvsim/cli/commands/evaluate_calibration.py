"""Show the effect of every threshold of the map builder: validity, coverage and edges for all its values.

Nothing is rendered. The stored evidence is decided again, for one threshold at a time. The other thresholds keep the
values that the map was built with. An occupancy map tests each corridor. The suggestion is the loosest threshold whose
validity has a 95 % interval (Wilson) with a lower end of at least --want."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from nvsim.cli import show
from nvsim.cli.arguments import Inline, ProjectArguments
from nvsim.cli.terminal import say
from nvsim.occupancy.heights import Heights
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    occupancy: Path | None = None
    """A ROS map.yaml, or an OctoMap .bt or .ot. Default: the built-in building's true map, or the map built for the
    project."""
    heights: Inline[Heights] = field(default_factory=Heights)
    map_frame: Literal["aligned", "capture"] = "aligned"
    """Frame of the map: the project's aligned frame, or the capture's own."""
    robot_radius: float = 0.25
    """Radius in meters for the metrics that end in _robot."""
    want: float = 0.99
    """Validity, below 1, that the lower end of the interval must reach."""
    out: Path | None = None
    """Folder for calibration.csv, .json, .svg and .png. Without it, no files are written."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.calibration import calibrate
    from nvsim.evaluation.calibration_report import text_of, write_calibration
    from nvsim.evaluation.truth import true_occupancy
    from nvsim.project.graph import thresholds_of

    a = arguments
    with Project.open(a.project) as project:
        graph, capture, config = project.need_graph(), project.need_capture(), thresholds_of(project)
        occupancy = true_occupancy(project, a.occupancy, a.map_frame, a.heights)
        show.notes(occupancy.notes)
        found = calibrate(graph, occupancy, capture.positions, config, a.want, a.robot_radius)
    files = write_calibration(found, a.out) if a.out is not None else []
    if a.json:
        show.figures({**asdict(found), "why_none": found.why_none, "files": [str(f) for f in files]}, True)
        return 0
    print(text_of(found), end="")
    if files:
        say(f"Written: {', '.join(map(str, files))}.")
    return 0
