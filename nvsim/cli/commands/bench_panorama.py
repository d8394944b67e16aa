"""Milliseconds of panoramas, whole and of the corridors' regions only, on a project or on a hall made in memory."""

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
    """A project with trained models; a furnished hall made in memory when left out."""
    rounds: int = 5
    """Medians are over so many."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """What draws: gsplat where it is installed and there is a CUDA card, else the kernels on the CPU."""
    memory: Memory = None
    """GiB for trained models; a quarter of the machine's when left out."""
    json: bool = False
    """Print one JSON object."""


def run(arguments: Arguments) -> int:
    import numpy as np

    from nvsim.benchmarks.panorama import furnished_hall, measure
    from nvsim.project.floor_heights import floor_of
    from nvsim.project.project import Project

    if arguments.rounds < 1:
        raise InputError(f"A median over {arguments.rounds} rounds is none; give --rounds 1 or more.")
    if arguments.project is None:
        model, places = furnished_hall()
        figures = measure(model, places, model.floor.height_at, arguments.rounds, arguments.backend)
    else:
        with Project.open(arguments.project) as project:
            scene = project.scene(memory_budget(arguments.memory))
            if scene is None:
                raise lacks(arguments.project, "train")
            positions, floor = project.need_capture().positions, floor_of(project)
        # Spread over the trajectory, and in its order, as a search goes from neighbour to neighbour.
        places = positions[np.linspace(0, len(positions) - 1, _PLACES).round().astype(int)]
        figures = measure(scene, places, floor.height_at, arguments.rounds, arguments.backend)
    show.figures(figures, arguments.json, "panoramas")
    return 0
