"""Milliseconds of a training step and its parts, on data made in memory."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show


@dataclass(frozen=True)
class Arguments:
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.training.benchmark import measure

    show.figures(measure(), arguments.json, "a training step")
    return 0
