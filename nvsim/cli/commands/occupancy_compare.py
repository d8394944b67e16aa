"""Compare an occupancy map with a true one: the shares of true free and true occupied cells that are free, occupied and
unknown in it."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from nvsim.cli import show
from nvsim.cli.arguments import Inline, Positional
from nvsim.occupancy.heights import Heights


@dataclass(frozen=True)
class Arguments:
    found: Positional[Path]
    """The map to test: a ROS map.yaml or an OctoMap .bt or .ot."""
    true: Positional[Path]
    """The true map, in one of these formats and in the frame of the first."""
    heights: Inline[Heights] = field(default_factory=Heights)
    json: bool = False
    """Print the results as JSON."""


def run(arguments: Arguments) -> int:
    from nvsim.occupancy.comparison import compare_maps
    from nvsim.occupancy.read import read_map

    found, true = (read_map(path, arguments.heights) for path in (arguments.found, arguments.true))
    show.notes((*found.notes, *true.notes))
    show.figures(compare_maps(found, true), arguments.json, "occupancy map")
    return 0
