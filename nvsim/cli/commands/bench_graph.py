"""Measure the milliseconds of an edit of a large navigation graph, including its findings, and until a window has drawn
it. Also measures the seconds to open and save a file. Without a display the window is drawn in memory. Without Qt the
window is skipped."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show
from nvsim.cli.window import installed, measured_by_window
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    edits: int = 300
    """Number of random edits to time."""
    viewpoints: int = 10_000
    """Viewpoints of the graph. Each has four edges and eight pieces of evidence."""
    window: bool = True
    """Measure the drawing in a window as well."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --edits or --viewpoints is out of range."""
    from nvsim.benchmarks.graph import measure

    if arguments.edits < 1 or arguments.viewpoints < 2:
        raise InputError("A measurement needs at least one edit and two viewpoints.")
    figures = measure(arguments.edits, arguments.viewpoints)
    if arguments.window and installed():
        painted = measured_by_window([f"--bench-edits={arguments.edits}", f"--viewpoints={arguments.viewpoints}"])
        figures = {"edit_p95_ms": figures.pop("edit_p95_ms"), "paint_p95_ms": painted.pop("paint_p95_ms"), **figures}
        figures |= painted
    show.figures(figures, arguments.json, "graph editing")
    return 0
