"""Milliseconds of an edit of a large navigation graph, its findings included, and seconds to open and save a file."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show


@dataclass(frozen=True)
class Arguments:
    edits: int = 300
    """How many random edits are timed."""
    viewpoints: int = 10_000
    """Of the graph; it has four edges and eight pieces of evidence for each."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.graph.benchmark import measure

    show.figures(measure(arguments.edits, arguments.viewpoints), arguments.json, "graph editing")
    return 0
