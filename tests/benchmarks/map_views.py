"""One project mapped from pitched views and from panoramas, by the Gaussians' normals and, where one is installed, by
those of a network: what either costs and how valid it is.

python -m tests.benchmarks.map_views PROJECT --truth MAP [--paper] [--widths 512 1024] [--json]

Nothing in the project changes. MAP is a ROS map.yaml or an OctoMap in the project's frame; --paper takes the paper's
decision and search, and only its thresholds differ from the other options of `nvsim map`, which are taken as well.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import tyro

from nvsim.cli import show
from nvsim.cli.normal_source import asked
from nvsim.evaluation.graph import evaluate_graph
from nvsim.evaluation.truth import true_occupancy
from nvsim.mapping.builder import build_map
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NormalSource
from nvsim.perception.normals_network import normals_file
from nvsim.project.floor_heights import floor_of
from nvsim.project.project import Project
from nvsim.project.scene_views import SceneViews

VALIDITIES = ("node_validity", "edge_validity", "node_validity_robot", "edge_validity_robot")
SHOWN = ("nodes", "edges", *VALIDITIES, "coverage", "components", "detour", "detour_p95", "seconds_per_viewpoint")


@dataclass(frozen=True)
class Arguments:
    project: tyro.conf.Positional[Path]
    truth: Path
    paper: bool = False
    widths: tuple[int, ...] = (MappingConfig.panorama_width,)
    """Pixels across the panoramas."""
    json: bool = False
    config: tyro.conf.OmitArgPrefixes[MappingConfig] = field(default_factory=MappingConfig)


def main() -> None:
    config = MappingConfig.paper() if "--paper" in sys.argv else MappingConfig()
    arguments = tyro.cli(Arguments, description=__doc__, default=Arguments(tyro.MISSING, tyro.MISSING, config=config))
    sources: tuple[NormalSource, ...] = ("gaussians",) if normals_file() is None else ("gaussians", "network", "both")
    tried = {"pitched": replace(arguments.config, views="pitched")}
    for width in arguments.widths:
        tried[f"panorama {width}"] = replace(arguments.config, views="panorama", panorama_width=width)
    with Project.open(arguments.project) as project:
        found = {
            f"{name}, {source}": measured(project, arguments.truth, asked(views, source))
            for name, views in tried.items()
            for source in sources
        }
    if arguments.json:
        print(json.dumps(found))
        return
    rows = [(key, *(_shown(figures, key) for figures in found.values())) for key in SHOWN]
    show.table(("figure", *found), rows, "the paper's map" if arguments.paper else "the map")


def measured(project: Project, truth: Path, config: MappingConfig) -> dict[str, Any]:
    """Figures of the map that is built under `config`; seconds are without those of compiling the kernels."""
    scene, support, capture = project.scene(), project.support(), project.need_capture()
    assert scene is not None and support is not None
    source, floor = SceneViews(scene, config), floor_of(project).height_at

    def built(config: MappingConfig) -> Any:
        return build_map(source, capture.positions, floor, support.at, config, scan="views")

    built(replace(config, max_viewpoints=1))
    result = built(config)
    occupancy = true_occupancy(project, truth, "aligned")
    figures = evaluate_graph(result.graph, occupancy, capture.positions, seen=support.at)
    report = result.report
    each = report["seconds"] / max(1, report["rendered_viewpoints"])
    return {**figures, "report": report, "seconds_per_viewpoint": round(each, 3)}


def _shown(figures: dict[str, Any], key: str) -> str:
    value = figures.get(key, "-")
    if key in VALIDITIES:
        return f"{value:.3f} ({figures[f'{key}_low']:.3f} to {figures[f'{key}_high']:.3f})"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    main()
