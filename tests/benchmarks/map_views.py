"""Compare maps of one project from pitched views and from panoramas, and from Gaussian and network normals.

python -m tests.benchmarks.map_views PROJECT --truth MAP [--paper] [--widths 512 1024] [--json]

It measures cost and validity. The project does not change. Normals of a network are tested if one is installed. MAP is
a ROS map.yaml or an OctoMap in the project's frame. All options of `nvsim map` are accepted; --paper selects their
defaults. The paper's search has no distance limit; --max-distance 4 keeps it inside the building.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from nvsim.cli.commands.stages import with_normal_source
from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.truth import true_occupancy
from nvsim.graph.types import NavGraph
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.corridor import DIRECTIONS, Corridor, HeightAt, SupportAt, view_of
from nvsim.mapping.criteria import OPEN, decide
from nvsim.mapping.families import NormalSource
from nvsim.mapping.views.floor_view import measure
from nvsim.mapping.views.view_sources import render_pitched_views
from nvsim.perception.normals_network import normals_model
from nvsim.project.floor_heights import floor_of
from nvsim.project.project import Project
from nvsim.project.scene_views import SceneViews
from tests.benchmarks.harness import report_columns, timed

VALIDITIES = ("node_validity", "edge_validity", "node_validity_robot", "edge_validity_robot")
AGREES = "agrees_with_first"
"""Share of the steps with the decision of the first column."""
FIGURES = ("coverage", "components", "detour", "detour_p95", AGREES)
SHOWN = ("nodes", "edges", *VALIDITIES, *FIGURES, "seconds_per_viewpoint")


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    truth: Path
    paper: bool = False
    widths: tuple[int, ...] = (MappingConfig.panorama_width,)
    """Widths of the panoramas, pixels."""
    json: bool = False
    config: tyro.conf.OmitArgPrefixes[MappingConfig] = field(default_factory=MappingConfig)


def main() -> None:
    config = MappingConfig.paper() if "--paper" in sys.argv else MappingConfig()
    arguments = tyro.cli(Arguments, description=__doc__, default=Arguments(tyro.MISSING, tyro.MISSING, config=config))
    sources: tuple[NormalSource, ...] = ("gaussians",) if normals_model() is None else ("gaussians", "network", "both")
    tried = {"pitched": replace(arguments.config, views="pitched")}
    for width in arguments.widths:
        tried[f"panorama {width}"] = replace(arguments.config, views="panorama", panorama_width=width)
    with Project.open(arguments.project) as project:
        found: dict[str, dict[str, Any]] = {}
        first: tuple[NavGraph, MappingConfig] | None = None
        for name, views in tried.items():
            for source in sources:
                config = with_normal_source(views, source)
                found[f"{name}, {source}"], graph = measured(project, arguments.truth, config, first)
                first = first or (graph, config)
    title = "the paper's map" if arguments.paper else "the map"
    report_columns(found, SHOWN, title, arguments.json, _shown)


def measured(
    project: Project, truth: Path, config: MappingConfig, first: tuple[NavGraph, MappingConfig] | None
) -> tuple[dict[str, Any], NavGraph]:
    """Metrics of the map built with `config`, its agreement with the `first` map, and its graph.

    Seconds are processor seconds per rendered viewpoint, without the compilation of kernels."""
    scene, support, capture = project.scene(), project.support(), project.need_capture()
    assert scene is not None and support is not None
    source, floor = SceneViews(scene, config), floor_of(project).height_at

    def built(config: MappingConfig) -> Any:
        return build_map(source, capture.positions, floor, support.is_supported, config, scan="views")

    built(replace(config, max_viewpoints=1))
    result, seconds = timed(lambda: built(config), time.process_time)
    occupancy = true_occupancy(project, truth, "aligned")
    figures = evaluate_graph(result.graph, occupancy, capture.positions, seen=support.is_supported)
    each = seconds / max(1, result.report["rendered_viewpoints"])
    found = {"seconds_per_viewpoint": round(each, 3), "report": result.report}
    if first is not None:
        found[AGREES] = agreement(*first, source, floor, support.is_supported, config)
    return {**figures, **found}, result.graph


def agreement(
    graph: NavGraph,
    before: MappingConfig,
    source: SceneViews,
    floor: HeightAt,
    support: SupportAt,
    config: MappingConfig,
) -> float:
    """Share of the steps with evidence in `graph` that `config` decides (open or closed) as `before` did. Only the
    criteria of the nearest model are used; later decisions of the search are ignored."""
    alike = []
    for viewpoint in graph.viewpoints.values():
        steps = [e for e in map(graph.evidence.get, ((viewpoint.id, k) for k in range(DIRECTIONS))) if e is not None]
        corridors = [Corridor(viewpoint.position[:2], e.target, viewpoint.position[2]) for e in steps]
        wanted: dict[int, list[Corridor]] = {}
        for corridor in corridors:
            wanted.setdefault(view_of(corridor, config), []).append(corridor)
        views = render_pitched_views(source, np.array(viewpoint.position), wanted, floor, config)
        for e, corridor in zip(steps, corridors, strict=True):
            again = measure(views[view_of(corridor, config)], viewpoint.id, 0, corridor, floor, support)
            alike.append((decide(replace(e, second=None), before) == OPEN) == (decide(again, config) == OPEN))
    return round(sum(alike) / max(1, len(alike)), 4)


def _shown(figures: Mapping[str, Any], key: str) -> str:
    value = figures.get(key, "-")
    if key in VALIDITIES:
        return f"{value:.3f} ({figures[f'{key}_low']:.3f} to {figures[f'{key}_high']:.3f})"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
