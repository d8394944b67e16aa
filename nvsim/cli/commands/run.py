"""Commands that run all stages: on a capture, or on the built-in building. Both end with a summary."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import tyro

from nvsim.building.config import Style
from nvsim.cli.arguments import Inline, value_of_flag
from nvsim.cli.commands import app
from nvsim.cli.commands.capture import CapturePath
from nvsim.cli.commands.stages import paper_map_config, report_network_fallback, with_normal_source
from nvsim.cli.session import project_job
from nvsim.cli.terminal import print_lines
from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.errors import InputError
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NormalSource
from nvsim.project.config import CaptureConfig, DepthUse, RunConfig
from nvsim.training.config import Device, Preset, at_paper_scale, preset

if TYPE_CHECKING:
    from nvsim.project.project import Project


@dataclass(frozen=True)
class Run:
    """Build an R2R navigation graph from images of a building: run every stage in order, and continue interrupted
    ones."""

    capture: CapturePath
    project: Path
    """The project folder to create or to continue."""
    json: bool = False
    """Print events as JSON lines."""
    understood: Inline[CaptureConfig] = field(default_factory=CaptureConfig)
    preset: Preset = "nvsim"
    """The preset that the training options start from."""
    paper_scale: bool = False
    """Train models as large as the paper's: 30,000 steps, images of full size, a million Gaussians per submap, networks
    of full size. Needs a CUDA GPU to finish within a day."""
    device: Device = "auto"
    """Device of the training: a CUDA GPU with gsplat, the CPU, or auto for a GPU if there is one."""
    paper: bool = False
    """Use the paper's model and map: the preset splatfacto-i for training, and paper for the map."""
    normal_source: NormalSource = "criteria"
    """Upward normals that the map tests: the Gaussians', those that a network estimates from the rendered views, or
    both. criteria: as in --map.criteria."""
    depth: DepthUse = "auto"
    """When to estimate depth from the images: auto (if the capture has no LiDAR scan), always, or never."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[RunConfig] = field(default_factory=RunConfig)

    @staticmethod
    def defaults(argv: list[str]) -> Run:
        paper = "--paper" in argv
        name = value_of_flag(argv, "--preset", "splatfacto-i" if paper else "nvsim")
        train = at_paper_scale(preset(name)) if "--paper-scale" in argv else preset(name)
        config = RunConfig(train=train, map=paper_map_config() if paper else MappingConfig())
        return Run(cast(Path, tyro.MISSING), cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)

    def run(self) -> int:
        from nvsim.project import pipeline
        from nvsim.project.stages.imported_splats import is_splats
        from nvsim.training.compilation import compiling_ahead
        from nvsim.training.devices.choice import gpu_name

        config = replace(self.config, map=with_normal_source(self.config.map, self.normal_source))
        if self.device != "auto":
            config = replace(config, train=replace(config.train, device=self.device))
        if self.cluster.executor == "local":
            gpu_name(config.train.device)  # raises an error before anything is imported
        cluster = self.cluster
        with (
            open_executor(cluster) as executor,
            project_job(self.project, "run", self.json, create=True) as (project, listen),
            compiling_ahead(cluster.executor == "local" and not is_splats(self.capture)),
        ):
            if self.paper:
                report_network_fallback(config.map, self.normal_source, listen)
            pipeline.run(
                project,
                self.capture,
                self.understood,
                config,
                listen,
                self.depth,
                executor,
            )
            end = [] if self.json else summary(project)
        print_lines(*end)
        return 0


@dataclass(frozen=True)
class Demo:
    """Generate the built-in building, run all stages on it, compare the graph with ground truth, and open the
    window."""

    project: Path = Path("demo.nvsim")
    """The project folder to create or to continue."""
    seed: int = 0
    """Random seed of the building. Equal seeds give equal buildings on every machine."""
    small: bool = False
    """Generate two rooms instead of 300 square meters."""
    area: int = 0
    """Area in square meters, 250 to 20000, of a different building with shops along wide halls. 6000 is a shopping
    center with 4,300 images, which takes hours."""
    storeys: Literal[1, 2] = 1
    """Number of storeys. With 2, a second storey of equal size is added, with a stair that the trajectory uses in both
    directions."""
    style: Style = "furnished"
    """glass: glass partitions and screens, which the LiDAR scan does not show. bare: plain walls, little furniture."""
    no_window: bool = False
    """Do not open the window at the end."""
    json: bool = False
    """Print events as JSON lines."""
    preset: Preset = "nvsim"
    """The preset that the training options start from."""
    depth: DepthUse = "auto"
    """When to estimate depth from the images: auto (if the capture has no LiDAR scan), always, or never."""
    config: Inline[RunConfig] = field(default_factory=RunConfig)

    @staticmethod
    def defaults(argv: list[str]) -> Demo:
        name = value_of_flag(argv, "--preset", "nvsim")
        config = RunConfig(train=preset(name))
        return Demo(preset=cast(Any, name), config=config)

    def run(self) -> int:
        """Runs the command. Raises InputError if --small and --area are both given."""
        from nvsim.building import BuildingConfig, generate
        from nvsim.evaluation.graph import evaluate_graph
        from nvsim.evaluation.truth import maps_in_aligned_frame
        from nvsim.project import pipeline
        from nvsim.training.compilation import compiling_ahead

        if self.small and self.area:
            raise InputError("--small and --area give different buildings; name only one of them.")
        size: Literal["full", "small", "halls"] = "halls" if self.area else "small" if self.small else "full"
        options = {"storeys": self.storeys, "style": self.style, "area": self.area}
        config = BuildingConfig(self.seed, size, **cast(Any, options))
        with project_job(self.project, "demo", self.json, create=True) as (project, listen), compiling_ahead():
            generate(project.layout.root, config, listen)
            capture = project.layout.built_in_capture
            pipeline.run(project, capture, CaptureConfig(), self.config, listen, self.depth)
            built, layout = project.need_capture(), project.layout
            truth = maps_in_aligned_frame(layout.true_map or layout.ground_truth, built, "aligned")
            support = project.support()
            seen = None if support is None else support.is_supported
            figures = evaluate_graph(project.need_graph(), truth, built.positions, seen=seen)
            project.set_result("graph", figures)
            end = [] if self.json else summary(project)
        print_lines(*end)
        return app.open_if_wanted(self.project, wanted=not self.no_window)


def summary(project: Project) -> list[str]:
    """The lines of the summary. Raises InputError if the project has no graph."""
    from nvsim.graph.paths import components

    graph = project.need_graph()
    parts = components(graph)
    included = {id for part in parts for id in part}
    edges = sum(a in included and b in included for a, b in graph.edges)
    figures = _current_figures(project, len(included), edges)
    root = project.layout.root
    name = shlex.quote(str(root))
    quality = _quality(figures) if figures else [("Validity", "not measured, because it needs an occupancy map")]
    capture, layout = project.capture(), project.layout
    models = layout.models if capture is None or capture.has_images else layout.model(0).parent
    files = [
        (str(models), "trained models; their PLY files open in any splat viewer"),
        *([(str(layout.masks), "floor masks")] if models == layout.models else []),
        (str(layout.database), "navigation graph with its evidence, for NVSim"),
    ]
    steps = [
        (app.command(root), "look at the graph and edit it"),
        (f"nvsim graph check {name}", "list problems of the graph"),
        *([] if figures else [(f"nvsim evaluate graph --project {name} --occupancy map.yaml", "measure validity")]),
        (f"nvsim export r2r --project {name} --out connectivity", "write the graph for agents"),
        (f"nvsim export scan --project {name} --out scans --views", "write the images for agents"),
    ]
    return [
        "",
        f"Navigation graph of {root}",
        *_columns([*_size(parts, edges), *quality]),
        "",
        "Files",
        *_columns(files),
        "",
        "Next steps",
        *_columns(steps),
    ]


def _current_figures(project: Project, nodes: int, edges: int) -> Mapping[str, Any] | None:
    """The figures of the last evaluation of the graph. None if the map was built or edited after it."""
    built = getattr(project.stage_results().part("map"), "finished", 0.0)
    measured = project.result_times().get("graph")
    if measured is None or measured < built:
        return None
    figures = project.results()["graph"]
    return figures if (figures.get("nodes"), figures.get("edges")) == (nodes, edges) else None


def _size(parts: list[list[str]], edges: int) -> list[tuple[str, str]]:
    rows = [("Viewpoints", str(sum(map(len, parts)))), ("Edges", str(edges))]
    if len(parts) > 1:
        rows.append(("Connected", f"no: {len(parts)} separate parts, the largest with {len(parts[0])} viewpoints"))
    elif parts:
        rows.append(("Connected", "yes: every viewpoint can be reached from every other"))
    return rows


def _quality(figures: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ("Valid viewpoints", _share(figures, "node_validity")),
        ("Valid edges", _share(figures, "edge_validity")),
        ("Coverage", f"{_percent(figures['coverage'])} of {figures['reachable_m2']:.0f} m² of reachable floor"),
    ]
    if "coverage_seen" in figures:
        seen = f"{_percent(figures['coverage_seen'])} of the {figures['seen_m2']:.0f} m² that the capture shows"
        rows.append(("", seen))
    return rows


def _share(figures: Mapping[str, Any], name: str) -> str:
    if f"{name}_low" not in figures:
        return _percent(figures[name])
    low, high = (_percent(figures[f"{name}_{end}"]) for end in ("low", "high"))
    return f"{_percent(figures[name])} (95 % interval: {low} to {high})"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _columns(rows: list[tuple[str, str]]) -> list[str]:
    width = max(len(left) for left, _ in rows)
    return [f"  {left:<{width}}  {right}" for left, right in rows]
