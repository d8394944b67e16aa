"""Search the trained models breadth-first and build the navigation graph, with evidence for every direction."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import tyro

from nvsim.cli.arguments import Inline, Memory, ProjectArguments, given, memory_budget
from nvsim.cli.normal_source import asked, papers, say_if_it_falls_back
from nvsim.cli.session import working
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NormalSource
from nvsim.project.stages import mapped


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    reapply: bool = False
    """Decide the stored evidence again with these thresholds. Only corridors that newly open are rendered."""
    preset: Literal["nvsim", "paper"] = "nvsim"
    """The values that the other options start from: NVSim's defaults, or the paper's."""
    paper: bool = False
    """Short for --preset paper."""
    normal_source: NormalSource = "criteria"
    """Upward normals that must pass: the Gaussians', those that a network estimates from the rendered views, or both.
    criteria: as in --criteria."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """Renderer: gsplat if it is installed and there is a CUDA GPU, else the CPU kernels."""
    memory: Memory = None
    """GiB of memory for trained models. Default: a quarter of the machine's memory."""
    config: Inline[MappingConfig] = field(default_factory=MappingConfig)


def defaults(argv: list[str]) -> Arguments:
    name = given(argv, "--preset", "paper" if "--paper" in argv else "nvsim")
    config = papers() if name == "paper" else MappingConfig()
    return Arguments(cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)


def run(arguments: Arguments) -> int:
    budget = memory_budget(arguments.memory)
    config = asked(arguments.config, arguments.normal_source)
    with working(arguments.project, "map", arguments.json) as (project, listen):
        if arguments.preset == "paper":
            say_if_it_falls_back(config, arguments.normal_source, listen)
        mapped.run(project, config, listen, arguments.reapply, budget, arguments.backend)
    return 0
