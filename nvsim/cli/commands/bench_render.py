"""Measure the milliseconds of a view of many Gaussians, part by part, forward and backward, on the CPU or a GPU."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli import show
from nvsim.errors import InputError
from nvsim.training.config import Device
from nvsim.training.devices.choice import card


@dataclass(frozen=True)
class Arguments:
    scene: Path | None = None
    """A splat file (.ply, .spz, .splat, .sog), seen from (1.8, 1.6, 1.6) towards (6, 4.8, 1) with a field of view of 70
    degrees. Default: a room made in memory."""
    gaussians: int = 100_000
    """Gaussians of the room in memory."""
    size: str = "640x480"
    """Width and height in pixels."""
    rounds: int = 15
    """Number of rounds per median."""
    classic: bool = False
    """Render without opacity compensation."""
    device: Device = "auto"
    """Renderer: gsplat on a CUDA GPU, the CPU kernels, or auto for a GPU if there is one."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if an option is invalid."""
    from nvsim.benchmarks.random_room import random_room
    from nvsim.benchmarks.render import inside_view, measure
    from nvsim.splats.formats.choice import read_splats

    a = arguments
    width, _, height = a.size.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise InputError(f"The size {a.size!r} is not valid; write it as 640x480.")
    if a.rounds < 1 or a.gaussians < 1:
        raise InputError("A measurement needs at least one round and one Gaussian.")
    if a.scene is None:
        gaussians = random_room(a.gaussians)
    else:
        splats = read_splats(a.scene)
        gaussians = splats.gaussians
        show.notes(splats.notes)
    camera, place = inside_view(int(width), int(height)), card(a.device)
    if place is None:
        figures = measure(gaussians, camera, not a.classic, a.rounds)
    else:
        from nvsim.benchmarks.render_card import measure as measure_card

        figures = measure_card(gaussians, camera, not a.classic, a.rounds, place)
    show.figures(figures, a.json, "a view")
    return 0
