"""Milliseconds of a training step and its parts, against drawing and its way back, on a room made in memory."""

from __future__ import annotations

from dataclasses import dataclass

from nvsim.cli import show
from nvsim.errors import InputError
from nvsim.training.config import Device, Preset


@dataclass(frozen=True)
class Arguments:
    gaussians: int = 100_000
    """How many there are."""
    size: str = "640x480"
    """Pixels of an image, WIDTHxHEIGHT."""
    sh_degree: int = 3
    """Degree of their spherical harmonics, 0 to 3."""
    preset: Preset = "nvsim"
    """Whose losses and colours; Gaussians and their harmonics are as many as said above."""
    device: Device = "auto"
    """Where the Gaussians are: on a CUDA card, beside a plain step of gsplat and torch, on the CPU, or auto for the
    card where there is one."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    from nvsim.benchmarks.train import measure

    try:
        width, height = (int(part) for part in arguments.size.lower().split("x"))
    except ValueError as error:
        raise InputError(f"--size {arguments.size} is no image size; say it as 640x480.") from error
    if min(width, height, arguments.gaussians) < 1 or not 0 <= arguments.sh_degree <= 3:
        raise InputError("--gaussians and both sides of --size have to be positive, and --sh-degree 0 to 3.")
    a = arguments
    figures = measure(a.gaussians, width, height, a.sh_degree, device=a.device, preset_name=a.preset)
    show.figures(figures, arguments.json, "a training step")
    return 0
