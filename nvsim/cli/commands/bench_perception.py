"""Milliseconds of the networks of floor and normals for an image."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show
from nvsim.errors import InputError
from nvsim.networks.installed import BUNDLED


@dataclass(frozen=True)
class Arguments:
    width: int = 540
    height: int = 360
    images: int = 20
    """How often each network looks at it."""
    semantic: str = BUNDLED
    """The network of looks: a model's name (nvsim models)."""
    normals: str = BUNDLED
    """The network of normals."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.benchmarks.perception import measure

    a = arguments
    if not (16 <= a.width <= 8192 and 16 <= a.height <= 8192 and 1 <= a.images <= 10_000):
        raise InputError("An image has 16 to 8192 pixels a side, and --images is 1 to 10000.")
    show.figures(measure(a.width, a.height, a.images, a.semantic, a.normals), a.json, "perception")
    return 0
