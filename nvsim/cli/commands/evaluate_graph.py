"""Validity and coverage of the navigation graph against an occupancy map."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli import show
from nvsim.cli.arguments import ProjectArguments
from nvsim.errors import InputError
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    occupancy: Path | None = None
    """A ROS map.yaml, an OctoMap .bt, or a storeys.json (or its folder), which names a map for each storey; the truth
    of the built-in building when left out."""
    map_frame: Literal["aligned", "capture"] = "aligned"
    """The frame that the map is in: the project's upright one, or the capture's own."""
    robot_radius: float = 0.25
    """Metres, for the figures that end in _robot."""
    picture: Path | None = None
    """Draw the graph over the map into this PNG."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.graph import evaluate_graph
    from nvsim.evaluation.picture import draw_graph
    from nvsim.evaluation.truth import maps_in_aligned_frame

    with Project.open(arguments.project) as project:
        graph, capture = project.need_graph(), project.need_capture()
        walk = capture.positions
        truth = arguments.occupancy or project.layout.true_map
        if truth is None:
            if arguments.picture is None:
                raise InputError(f"{project.layout.root} has no true map; name one with --occupancy MAP.")
            draw_graph(graph, project.occupancy(), walk, arguments.picture)
            show.figures({"nodes": len(graph.viewpoints), "edges": len(graph.edges)}, arguments.json, "graph")
            return 0
        occupancy = maps_in_aligned_frame(truth, capture, arguments.map_frame)
        result = evaluate_graph(graph, occupancy, walk, robot_radius=arguments.robot_radius)
        if arguments.picture is not None:
            draw_graph(graph, occupancy, walk, arguments.picture)
    show.figures(result, arguments.json, "navigation graph")
    return 0
