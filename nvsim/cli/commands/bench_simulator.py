"""Measure the states and images per second of the simulator: without images for 1 and 64 environments, from skyboxes at
640 x 480, and live from the trained models of a project if one is named."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.errors import InputError


@dataclass(frozen=True)
class Arguments:
    project: Path | None = None
    """A project with trained models and a graph, whose views are rendered live."""
    seconds: float = 2.0
    """Duration of each measurement in seconds."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --seconds is out of range."""
    from nvsim.benchmarks.simulator import measure

    if not 0 < arguments.seconds <= 600:
        raise InputError(f"--seconds {arguments.seconds:g} is out of range; give --seconds from 0.1 to 600.")
    show.figures(measure(arguments.project, arguments.seconds), arguments.json, "simulator")
    return 0
