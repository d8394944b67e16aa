"""Measure the milliseconds of a training step and its parts, compared with rendering forward and backward, on a room
made in memory."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show
from nvsim.errors import InputError
from nvsim.training.config import Device, Preset


@dataclass(frozen=True)
class Arguments:
    gaussians: int = 100_000
    """Number of Gaussians."""
    size: str = "640x480"
    """Pixels of an image, WIDTHxHEIGHT."""
    sh_degree: int = 3
    """Degree of their spherical harmonics, 0 to 3."""
    preset: Preset = "nvsim"
    """Preset of losses and colors. The options above set the Gaussians and their harmonics."""
    device: Device = "auto"
    """Device: a CUDA GPU, where a plain step of gsplat and torch is measured too, the CPU, or auto for a GPU if there
    is one."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if an option is invalid."""
    from nvsim.benchmarks.train import measure

    try:
        width, height = (int(part) for part in arguments.size.lower().split("x"))
    except ValueError as error:
        raise InputError(f"--size {arguments.size} is not an image size; write it as 640x480.") from error
    if min(width, height, arguments.gaussians) < 1 or not 0 <= arguments.sh_degree <= 3:
        raise InputError("--gaussians and both sides of --size must be positive, and --sh-degree 0 to 3.")
    a = arguments
    figures = measure(a.gaussians, width, height, a.sh_degree, device=a.device, preset_name=a.preset)
    show.figures(figures, arguments.json, "a training step")
    return 0
