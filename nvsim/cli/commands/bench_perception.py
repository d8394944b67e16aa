"""Measure the milliseconds of the floor and normals networks for an image."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show
from nvsim.errors import InputError
from nvsim.networks.installed import BUNDLED


@dataclass(frozen=True)
class Arguments:
    width: int = 540
    """Width of the image in pixels."""
    height: int = 360
    """Height of the image in pixels."""
    images: int = 20
    """Number of runs of each network."""
    semantic: str = BUNDLED
    """The semantic network: a model's name (see nvsim models)."""
    normals: str = BUNDLED
    """The normals network."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if the image size or --images is out of range."""
    from nvsim.benchmarks.perception import measure

    a = arguments
    if not (16 <= a.width <= 8192 and 16 <= a.height <= 8192 and 1 <= a.images <= 10_000):
        raise InputError("--width and --height must be 16 to 8192 pixels, and --images 1 to 10000.")
    show.figures(measure(a.width, a.height, a.images, a.semantic, a.normals), a.json, "perception")
    return 0
