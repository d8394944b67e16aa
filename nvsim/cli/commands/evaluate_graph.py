"""Validity and coverage of the navigation graph against an occupancy map."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from nvsim.cli import show
from nvsim.cli.arguments import Inline, ProjectArguments
from nvsim.errors import InputError
from nvsim.occupancy.heights import Heights
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    occupancy: Path | None = None
    """A ROS map.yaml or an OctoMap .bt or .ot; the built-in building's truth, or else the map that was
    built in the project, when left out. One that was made of the depth of this project's own models is refused."""
    heights: Inline[Heights] = field(default_factory=Heights)
    map_frame: Literal["aligned", "capture"] = "aligned"
    """The frame that the map is in: the project's upright one, or the capture's own."""
    robot_radius: float = 0.25
    """Metres, for the figures that end in _robot."""
    picture: Path | None = None
    """Draw the graph over the map into this PNG."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.graph import evaluate_graph
    from nvsim.evaluation.picture import draw_graph
    from nvsim.evaluation.truth import occupancy_in_aligned_frame
    from nvsim.project.built_map import refuse_own_depth, true_map

    with Project.open(arguments.project) as project:
        graph, capture = project.need_graph(), project.need_capture()
        walk = capture.positions[:, :2]
        truth = arguments.occupancy or true_map(project)
        if truth is None:
            if arguments.picture is None:
                raise InputError(
                    f"{project.layout.root} has no map to judge by; name one with --occupancy MAP, or build one with "
                    "`nvsim occupancy build --project`."
                )
            draw_graph(graph, project.occupancy(), walk, arguments.picture)
            show.figures({"nodes": len(graph.viewpoints), "edges": len(graph.edges)}, arguments.json, "graph")
            return 0
        refuse_own_depth(truth, project)
        occupancy = occupancy_in_aligned_frame(truth, capture, arguments.map_frame, arguments.heights)
        result = evaluate_graph(graph, occupancy, walk, robot_radius=arguments.robot_radius)
        if arguments.picture is not None:
            draw_graph(graph, occupancy, walk, arguments.picture)
    show.figures(result, arguments.json, "navigation graph")
    return 0
