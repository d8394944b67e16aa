"""Commands that measure the navigation graph, its thresholds, and its criteria on an occupancy map."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import tyro

from nvsim.cli import terminal
from nvsim.cli.arguments import Inline, ProjectArguments, value_of_flag
from nvsim.cli.session import project_job
from nvsim.cli.terminal import print_lines
from nvsim.events import Done
from nvsim.files.atomic import refuse_unwritable_folder
from nvsim.mapping.config import MappingConfig
from nvsim.occupancy.types import Heights


@dataclass(frozen=True)
class EvaluateGraph(ProjectArguments):
    """Measure validity, coverage and structure of the navigation graph on an occupancy map."""

    occupancy: Path | None = None
    """A ROS map.yaml, an OctoMap .bt or .ot, or a storeys.json (or its folder), which names a map for each storey.
    Default: the built-in building's true map, else the map that was built in the project. A map from the depth of this
    project's own models is refused."""
    heights: Inline[Heights] = field(default_factory=Heights)
    map_frame: Literal["aligned", "capture"] = "aligned"
    """Frame of the map: the project's aligned frame, or the capture's own."""
    robot_radius: float = 0.25
    """Radius in meters for the metrics that end in _robot."""
    picture: Path | None = None
    """Draw the graph on the map as this PNG file."""

    def run(self) -> int:
        from nvsim.evaluation.graph import evaluate_graph
        from nvsim.evaluation.picture import draw_graph
        from nvsim.evaluation.structure import MATTERPORT, SOURCE
        from nvsim.evaluation.truth import true_maps
        from nvsim.project.graph import thresholds_of
        from nvsim.project.occupancy_maps import occupancy_of, true_map
        from nvsim.project.project import Project

        with Project.open(self.project) as project:
            graph, capture = project.need_graph(), project.need_capture()
            walk = capture.positions
            truth = self.occupancy or true_map(project)
            if truth is None and self.picture is not None:
                draw_graph(graph, occupancy_of(project), walk, self.picture)
                terminal.figures({"nodes": len(graph.viewpoints), "edges": len(graph.edges)}, self.json, "graph")
                return 0
            occupancy = true_maps(project, truth, self.map_frame, self.heights)
            terminal.print_notes(occupancy.notes)
            support = project.support()
            seen = None if support is None else support.is_supported
            least = thresholds_of(project).photographed
            result = evaluate_graph(graph, occupancy, walk, self.robot_radius, seen=seen, photographed=least)
            if self.picture is not None:
                draw_graph(graph, occupancy, walk, self.picture)
        if self.json:
            terminal.figures(result, True)
            return 0
        rows = []
        for name, value in result.items():
            if f"{name}_low" in result:
                value = f"{value:.4g} ({result[f'{name}_low']:.4g} to {result[f'{name}_high']:.4g})"
            if not name.endswith(("_low", "_high")):
                rows.append((name, value, MATTERPORT.get(name, "-")))
        terminal.table(("metric", "this graph", "Matterport"), rows, "navigation graph")
        print_lines("In brackets: 95 % intervals (Wilson).")
        print_lines(f"Matterport: {SOURCE}; near pairs are those that see each other, because there is no map.")
        return 0


@dataclass(frozen=True)
class EvaluateCalibration(ProjectArguments):
    """Show the effect of every threshold of the map builder: validity, coverage and edges for all its values.

    Nothing is rendered. The stored evidence is decided again, for one threshold at a time. The other thresholds keep
    the values that the map was built with. An occupancy map tests each corridor. The suggestion is the loosest
    threshold whose validity has a 95 % interval (Wilson) with a lower end of at least --want.
    """

    occupancy: Path | None = None
    """A ROS map.yaml, or an OctoMap .bt or .ot. Default: the built-in building's true map, or the map built for the
    project."""
    heights: Inline[Heights] = field(default_factory=Heights)
    map_frame: Literal["aligned", "capture"] = "aligned"
    """Frame of the map: the project's aligned frame, or the capture's own."""
    robot_radius: float = 0.25
    """Radius in meters for the metrics that end in _robot."""
    want: float = 0.99
    """Validity, below 1, that the lower end of the interval must reach."""
    out: Path | None = None
    """Folder for calibration.csv, .json, .svg and .png. Without it, no files are written."""

    def run(self) -> int:
        from nvsim.evaluation.calibrated import text_of, write_calibration
        from nvsim.evaluation.calibration import calibrate
        from nvsim.evaluation.truth import true_occupancy
        from nvsim.project.graph import thresholds_of
        from nvsim.project.project import Project

        if self.out is not None:
            refuse_unwritable_folder(self.out)
        with Project.open(self.project) as project:
            graph, capture, config = project.need_graph(), project.need_capture(), thresholds_of(project)
            occupancy = true_occupancy(project, self.occupancy, self.map_frame, self.heights)
            terminal.print_notes(occupancy.notes)
            found = calibrate(graph, occupancy, capture.positions, config, self.want, self.robot_radius)
        files = write_calibration(found, self.out) if self.out is not None else []
        if self.json:
            terminal.figures({**asdict(found), "why_none": found.why_none, "files": [str(f) for f in files]}, True)
            return 0
        print(text_of(found), end="")
        if files:
            print_lines(f"Written: {', '.join(map(str, files))}.")
        return 0


@dataclass(frozen=True)
class EvaluateValidityTable(ProjectArguments):
    """Make the paper's fourth table: the validity of maps by scene representation and set of criteria.

    Trains 3dgs, splatfacto-w, splatfacto-i and nvsim on every submap unless the ablation has done so. Builds a map for
    each set of criteria, and tests it on an occupancy map. Models are stored in the project (ablation/), and maps too
    (validity/), so a later call continues an interrupted one. The project's own models and graph are not changed.
    """

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
    repeat: bool = False
    """Build every map again. Models are reused."""
    out: Path | None = None
    """Folder for validity.txt, .csv, .tex and an image per map. Default: validity/ in the project."""
    preset: Literal["nvsim", "paper"] = "nvsim"
    """The thresholds to start from, as in `nvsim map`: NVSim's defaults, or the paper's."""
    config: Inline[MappingConfig] = field(default_factory=MappingConfig)

    @staticmethod
    def defaults(argv: list[str]) -> EvaluateValidityTable:
        name = value_of_flag(argv, "--preset", "nvsim")
        config = MappingConfig.paper() if name == "paper" else MappingConfig()
        return EvaluateValidityTable(cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)

    def run(self) -> int:
        from nvsim.evaluation.ablation_runs import Budget
        from nvsim.evaluation.truth import true_occupancy
        from nvsim.evaluation.validity import STAGE, TableConfig, cells_folder, evaluate_validity
        from nvsim.evaluation.validity_report import text_of, write_validity

        if self.out is not None:
            refuse_unwritable_folder(self.out)
        config = TableConfig(
            self.presets,
            tuple(tuple(column.split("+")) for column in self.columns),
            Budget(self.steps, self.image_size, self.gaussian_cap),
            self.seed,
            self.config,
            self.config.robot_radius,
            self.repeat,
        )
        with project_job(self.project, "evaluate validity-table", self.json) as (project, listen):
            occupancy = true_occupancy(project, self.occupancy, self.map_frame, self.heights)
            terminal.print_notes(occupancy.notes)
            table = evaluate_validity(project, config, occupancy, listen)
            walk = project.need_capture().positions[:, :2]
            files = write_validity(table, self.out or cells_folder(project), occupancy, walk)
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
        if not self.json:
            print(text_of(table), end="", flush=True)
        return 0
