"""The paper's fourth table: how valid the map is that each representation gives under each set of criteria.

Trains 3dgs, splatfacto-w, splatfacto-i and nvsim on every submap where the ablation has not done so, builds a map for
each set of criteria, and judges it by an occupancy map. Models are kept in the project (ablation/), maps as well
(validity/), so that a later call goes on where this one was cut off; the project's own models and graph stay as they
are."""

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
    """A ROS map.yaml, or an OctoMap .bt or .ot; when left out the built-in building's truth, or the map built for the
    project."""
    heights: Inline[Heights] = field(default_factory=Heights)
    map_frame: Literal["aligned", "capture"] = "aligned"
    """The frame that the map is in: the project's upright one, or the capture's own."""
    presets: tuple[str, ...] = ()
    """Only these rows."""
    columns: tuple[str, ...] = ("alpha+normal", "alpha", "normal", "depth", "slice")
    """Sets of criteria, joined by +."""
    steps: int | None = None
    """Steps of every model; as the preset nvsim has it when left out."""
    image_size: int | None = None
    """Longest side of the training images of every model, pixels; likewise."""
    gaussian_cap: int | None = None
    """Most Gaussians of every model; likewise."""
    seed: int = 0
    """Of the training."""
    afresh: bool = False
    """Build every map again; models are kept."""
    out: Path | None = None
    """Folder for validity.txt, .csv, .tex and an image per map; the project's validity/ when left out."""
    preset: Literal["nvsim", "paper"] = "nvsim"
    """What the thresholds start from: our defaults, or the paper's; as `nvsim map` has it."""
    config: Inline[MappingConfig] = field(default_factory=MappingConfig)


def defaults(argv: list[str]) -> Arguments:
    name = given(argv, "--preset", "nvsim")
    config = MappingConfig.paper() if name == "paper" else MappingConfig()
    return Arguments(cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.ablation_rows import Budget
    from nvsim.evaluation.truth import true_occupancy
    from nvsim.evaluation.validity import STAGE, TableConfig, evaluate_validity
    from nvsim.evaluation.validity_cell import cells_folder
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
        words = f"{table.trained} models trained, {table.built} maps built, {table.reused} were there"
        listen(Done(STAGE, f"{words}; {files[0].parent}", results))
    if not a.json:
        print(text_of(table), end="", flush=True)
    return 0
