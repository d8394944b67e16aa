"""List the edges that a user should review, the least certain first."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments:
    graph: Positional[Path]
    """A project, NAME.nvsim, or an R2R connectivity file."""
    count: int = 20
    """Number of edges to list."""
    json: bool = False
    """Print the edges as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.cli import show
    from nvsim.cli.graph_source import one_source
    from nvsim.graph.review import Review

    source = one_source(arguments.graph)
    order = Review(source.margin).order(source.graph)
    first = order[: max(0, arguments.count)]
    if arguments.json:
        rows = [{"edge": d.edge, "margin": None if math.isnan(d.margin) else d.margin, "why": d.why} for d in first]
        say(as_json({"unreviewed": len(order), "edges": rows}))
        return 0
    rows_of = [(*map(source.graph.short, d.edge), d.why) for d in first]
    show.table(("from", "to", "why"), rows_of, f"{len(order)} edges are not reviewed")
    return 0
