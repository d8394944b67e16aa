"""Measure the milliseconds of panoramas, complete and only the corridors' regions, on a project or a hall in memory."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nvsim.cli import show
from nvsim.cli.arguments import Memory, memory_budget
from nvsim.errors import InputError
from nvsim.project.work import lacks

_PLACES = 8


@dataclass(frozen=True)
class Arguments:
    project: Path | None = None
    """A project with trained models. Default: a furnished hall made in memory."""
    rounds: int = 5
    """Number of rounds per median."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """Renderer: gsplat if it is installed and there is a CUDA GPU, else the CPU kernels."""
    memory: Memory = None
    """GiB of memory for trained models. Default: a quarter of the machine's memory."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if an option is invalid, or if the project has no models."""
    import numpy as np

    from nvsim.benchmarks.panorama import furnished_hall, measure
    from nvsim.project.floor_heights import floor_of
    from nvsim.project.project import Project

    if arguments.rounds < 1:
        raise InputError(f"--rounds {arguments.rounds} is out of range; give --rounds 1 or more.")
    if arguments.project is None:
        model, places = furnished_hall()
        figures = measure(model, places, model.floor.height_at, arguments.rounds, arguments.backend)
    else:
        with Project.open(arguments.project) as project:
            scene = project.scene(memory_budget(arguments.memory))
            if scene is None:
                raise lacks(arguments.project, "train")
            positions, floor = project.need_capture().positions, floor_of(project)
        # Evenly spread along the trajectory and in its order, because the search visits neighbors one after another.
        places = positions[np.linspace(0, len(positions) - 1, _PLACES).round().astype(int)]
        figures = measure(scene, places, floor.height_at, arguments.rounds, arguments.backend)
    show.figures(figures, arguments.json, "panoramas")
    return 0
