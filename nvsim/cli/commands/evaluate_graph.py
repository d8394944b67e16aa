"""Measure validity, coverage and structure of the navigation graph on an occupancy map."""

from __future__ import annotations

from dataclasses import dataclass, field
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
    """A ROS map.yaml, an OctoMap .bt or .ot, or a storeys.json (or its folder), which names a map for each storey.
    Default: the built-in building's true map, else the map that was built in the project. A map from the depth of this
    project's own models is refused."""
    heights: Inline[Heights] = field(default_factory=Heights)
    map_frame: Literal["aligned", "capture"] = "aligned"
    """Frame of the map: the project's aligned frame, or the capture's own."""
    robot_radius: float = 0.25
    """Radius in meters for the metrics that end in _robot."""
    picture: Path | None = None
    """Draw the graph on the map as this PNG file."""


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.graph import evaluate_graph
    from nvsim.evaluation.matterport import MATTERPORT, SOURCE
    from nvsim.evaluation.picture import draw_graph
    from nvsim.evaluation.truth import true_maps
    from nvsim.project.occupancy_maps import occupancy_of, true_map

    with Project.open(arguments.project) as project:
        graph, capture = project.need_graph(), project.need_capture()
        walk = capture.positions
        truth = arguments.occupancy or true_map(project)
        if truth is None and arguments.picture is not None:
            draw_graph(graph, occupancy_of(project), walk, arguments.picture)
            show.figures({"nodes": len(graph.viewpoints), "edges": len(graph.edges)}, arguments.json, "graph")
            return 0
        occupancy = true_maps(project, truth, arguments.map_frame, arguments.heights)
        show.notes(occupancy.notes)
        support = project.support()
        seen = None if support is None else support.at
        result = evaluate_graph(graph, occupancy, walk, robot_radius=arguments.robot_radius, seen=seen)
        if arguments.picture is not None:
            draw_graph(graph, occupancy, walk, arguments.picture)
    if arguments.json:
        show.figures(result, True)
        return 0
    rows = []
    for name, value in result.items():
        if f"{name}_low" in result:
            value = f"{value:.4g} ({result[f'{name}_low']:.4g} to {result[f'{name}_high']:.4g})"
        if not name.endswith(("_low", "_high")):
            rows.append((name, value, MATTERPORT.get(name, "-")))
    show.table(("metric", "this graph", "Matterport"), rows, "navigation graph")
    say("In brackets: 95 % intervals (Wilson).")
    say(f"Matterport: {SOURCE}; near pairs are those that see each other, because there is no map.")
    return 0
