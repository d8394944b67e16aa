"""Milliseconds of an edit of a large navigation graph, its findings included, and until a window has painted it;
seconds to open and save a file. Without a display the window is drawn to memory; without Qt there is none."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show
from nvsim.cli.window import installed, measured_by_window


@dataclass(frozen=True)
class Arguments:
    edits: int = 300
    """How many random edits are timed."""
    viewpoints: int = 10_000
    """Of the graph; it has four edges and eight pieces of evidence for each."""
    window: bool = True
    """Measure the painting as well, in a window."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.benchmarks.graph import measure

    figures = measure(arguments.edits, arguments.viewpoints)
    if arguments.window and installed():
        painted = measured_by_window([f"--bench-edits={arguments.edits}", f"--viewpoints={arguments.viewpoints}"])
        figures = {"edit_p95_ms": figures.pop("edit_p95_ms"), "paint_p95_ms": painted.pop("paint_p95_ms"), **figures}
        figures |= painted
    show.figures(figures, arguments.json, "graph editing")
    return 0
