"""Propose edges and viewpoints that a navigation graph lacks: of a project, or of any R2R connectivity file with a map.

With --script, the proposals are written as a script of edits. Delete the lines that are wrong, and run the rest with
`nvsim graph replay`.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nvsim.cli.arguments import Inline, Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.occupancy.heights import Heights

if TYPE_CHECKING:
    from nvsim.graph.proposals import EdgeProposal, PlaceProposal


@dataclass(frozen=True)
class Arguments:
    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    occupancy: Path | None = None
    """A ROS map.yaml or an OctoMap .bt or .ot, instead of the one found next to the graph."""
    heights: Inline[Heights] = field(default_factory=Heights)
    reach: float = 3.5
    """Maximum length of proposed edges in meters."""
    sees: float = 3.0
    """Meters. If floor is farther than this from every viewpoint that sees it, a viewpoint is proposed."""
    robot_radius: float = 0.25
    """Radius of the robot in meters."""
    count: int = 20
    """Maximum number of proposed edges, and of proposed viewpoints."""
    script: Path | None = None
    """Write the proposals as JSON lines into this file, for `nvsim graph replay`."""
    json: bool = False
    """Print the proposals as JSON."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if a distance is out of range, or if there is no evidence and no map."""

    from nvsim.cli import show
    from nvsim.cli.graph_source import one_source
    from nvsim.errors import InputError
    from nvsim.graph.proposals import propose_edges, propose_viewpoints
    from nvsim.graph.scripts import write_script

    for name in ("reach", "sees"):
        if not 0 < getattr(arguments, name) < 100:
            raise InputError(f"--{name} is {getattr(arguments, name)}; it must be between 0 and 100 meters.")
    source = one_source(arguments.graph, arguments.occupancy, arguments.heights)
    if source.occupancy is None and source.margin is None and source.visible is None:
        raise InputError(f"{arguments.graph} has no evidence and no map for proposals; name a map with --occupancy.")
    seen = source.visible if source.occupancy is None else None
    count, radius = max(0, arguments.count), max(0.0, arguments.robot_radius)
    edges = propose_edges(
        source.graph, source.occupancy, source.margin, visible=seen, reach=arguments.reach, radius=radius
    )[:count]
    places: tuple[PlaceProposal, ...] = ()
    if source.occupancy is not None:
        places = propose_viewpoints(
            source.graph, source.occupancy, sees=arguments.sees, radius=radius, reach=arguments.reach, most=count
        )
    if arguments.script is not None:
        write_script(arguments.script, _script(edges, places))
    if arguments.json:
        say(as_json({"edges": [_plain(e) for e in edges], "viewpoints": [_plain(p) for p in places]}))
    else:
        rows = [(*map(source.graph.short, e.edge), f"{e.score:.2f}", e.words) for e in edges]
        at = [(f"{p.position[0]:.2f}, {p.position[1]:.2f}", f"{p.score:.2f}", p.words) for p in places]
        for thing, head, lines in (("edge", ("from", "to"), rows), ("viewpoint", ("place",), at)):
            title = f"{len(lines)} {thing}{'' if len(lines) == 1 else 's'} proposed"
            show.table((*head, "score", "why"), lines, title) if lines else say(title)
    return 0


def _script(edges: tuple[EdgeProposal, ...], places: tuple[PlaceProposal, ...]) -> Iterator[str]:
    """The edits: one per edge, and each viewpoint followed by its edges. A comment before each gives the reason."""
    from nvsim.graph.operations import record
    from nvsim.graph.scripts import comment

    for e in edges:
        yield comment(e.words)
        yield json.dumps(record("add_edges", {"pairs": [e.edge]}))
    for p in places:
        yield comment(p.words)
        yield json.dumps(record("add_viewpoint", {"position": p.position, "height": p.height, "id": p.new_id}))
        if p.joins:
            yield json.dumps(record("add_edges", {"pairs": [(p.new_id, other) for other in p.joins]}))


def _plain(proposal: EdgeProposal | PlaceProposal) -> dict[str, Any]:
    """The fields of a proposal. JSON has no infinity, so the length of a missing path is null."""
    return {key: None if value == float("inf") else value for key, value in asdict(proposal).items()}
