"""Make the paper's fourth table: the validity of maps by scene representation and set of criteria.

Trains 3dgs, splatfacto-w, splatfacto-i and nvsim on every submap unless the ablation has done so. Builds a map for each
set of criteria, and tests it on an occupancy map. Models are stored in the project (ablation/), and maps too
(validity/), so a later call continues an interrupted one. The project's own models and graph are not changed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import tyro

from nvsim.cli import show
from nvsim.cli.arguments import Inline, ProjectArguments, given
from nvsim.cli.session import working
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.heights import Heights


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    occupancy: Path | None = None
    """A ROS map.yaml, or an OctoMap .bt or .ot. Default: the built-in building's true map, or the map built for the
    project."""
    heights: Inline[Heights] = field(default_factory=Heights)
    map_frame: Literal["aligned", "capture"] = "aligned"
    """Frame of the map: the project's aligned frame, or the capture's own."""
    presets: tuple[str, ...] = ()
    """Only these rows. Default: all."""
    columns: tuple[str, ...] = ("alpha+normal", "alpha", "normal", "depth", "slice")
    """Sets of criteria, joined by +."""
    steps: int | None = None
    """Steps of every model. Default: as in the preset nvsim."""
    image_size: int | None = None
    """Longest side of the training images of every model, pixels. Default: as in the preset nvsim."""
    gaussian_cap: int | None = None
    """Largest number of Gaussians of every model. Default: as in the preset nvsim."""
    seed: int = 0
    """Random seed of the training."""
    afresh: bool = False
    """Build every map again. Models are reused."""
    out: Path | None = None
    """Folder for validity.txt, .csv, .tex and an image per map. Default: validity/ in the project."""
    preset: Literal["nvsim", "paper"] = "nvsim"
    """The thresholds to start from, as in `nvsim map`: NVSim's defaults, or the paper's."""
    config: Inline[MappingConfig] = field(default_factory=MappingConfig)


def defaults(argv: list[str]) -> Arguments:
    name = given(argv, "--preset", "nvsim")
    config = MappingConfig.paper() if name == "paper" else MappingConfig()
    return Arguments(cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.ablation_runs import Budget
    from nvsim.evaluation.truth import true_occupancy
    from nvsim.evaluation.validity import STAGE, TableConfig, cells_folder, evaluate_validity
    from nvsim.evaluation.validity_report import text_of, write_validity
    from nvsim.events import Done

    a = arguments
    config = TableConfig(
        a.presets,
        tuple(tuple(column.split("+")) for column in a.columns),
        Budget(a.steps, a.image_size, a.gaussian_cap),
        a.seed,
        a.config,
        a.config.robot_radius,
        a.afresh,
    )
    with working(a.project, "evaluate validity-table", a.json) as (project, listen):
        occupancy = true_occupancy(project, a.occupancy, a.map_frame, a.heights)
        show.notes(occupancy.notes)
        table = evaluate_validity(project, config, occupancy, listen)
        walk = project.need_capture().positions[:, :2]
        files = write_validity(table, a.out or cells_folder(project), occupancy, walk)
        results: dict[str, Any] = {
            "cells": [
                {"model": cell.model, "criteria": "+".join(cell.criteria), "why": cell.why, **cell.figures}
                for cell in table.cells
            ],
            "left_out": table.left_out,
            "trained": table.trained,
            "built": table.built,
            "reused": table.reused,
            "files": [str(f) for f in files],
        }
        project.set_result("validity-table", results)
        words = f"{table.trained} models trained, {table.built} maps built, {table.reused} reused"
        listen(Done(STAGE, f"{words}; {files[0].parent}", results))
    if not a.json:
        print(text_of(table), end="", flush=True)
    return 0
