"""List the viewpoints and edges of a graph that match an expression, such as `degree > 4 and not reviewed`.

Quantities of viewpoints: id, x, y, z, height, submap, included, reviewed, locked, origin, degree, component, storey,
evidence, validity. Of edges: x, y, z, submap, component, storey, reviewed, locked, origin, length, slope, alpha,
evidence, validity.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.occupancy.heights import Heights


@dataclass(frozen=True)
class Arguments:
    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    where: Positional[str]
    """The expression."""
    kind: Literal["viewpoints", "edges"] | None = None
    """List only viewpoints or only edges. Default: both, if they have the quantities of the expression."""
    occupancy: Path | None = None
    """For `validity`: a ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.cli.graph_target import GraphTarget, refused_as_input
    from nvsim.graph.expression import by_expression

    target = GraphTarget(arguments.graph, arguments.occupancy, arguments.heights)
    graph = target.read()
    with refused_as_input():
        chosen = by_expression(graph, arguments.where, target.known(arguments.where), arguments.kind)
    viewpoints = [id for id in graph.viewpoints if id in chosen.viewpoints]
    edges = [key for key in graph.edges if key in chosen.edges]
    if arguments.json:
        say(as_json({"viewpoints": viewpoints, "edges": edges}))
    else:
        say(*viewpoints, *(f"{a} {b}" for a, b in edges))
    return 0
