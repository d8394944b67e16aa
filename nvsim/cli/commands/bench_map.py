"""Measure the viewpoints per second of the map builder, on a model made in memory."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show


@dataclass(frozen=True)
class Arguments:
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.benchmarks.map_builder import measure

    show.figures(measure(), arguments.json, "map building")
    return 0
