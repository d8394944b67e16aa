"""Generate the built-in building, run all stages on it, compare the graph with ground truth, and open the window."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

from nvsim.building.config import Style
from nvsim.cli import window
from nvsim.cli.arguments import Inline, given
from nvsim.cli.session import working
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.project import pipeline
from nvsim.project.config import CaptureConfig, DepthUse, RunConfig
from nvsim.training.config import Preset, preset


@dataclass(frozen=True)
class Arguments:
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
    """glass: glass partitions and screens, which the scan does not show. bare: plain walls, little furniture."""
    no_window: bool = False
    """Do not open the window at the end."""
    json: bool = False
    """Print events as JSON lines."""
    preset: Preset = "nvsim"
    """The preset that the training options start from."""
    depth: DepthUse = "auto"
    """When to estimate depth from the images: auto (if the capture has no scan), always, or never."""
    config: Inline[RunConfig] = field(default_factory=RunConfig)


def defaults(argv: list[str]) -> Arguments:
    name = given(argv, "--preset", "nvsim")
    config = RunConfig(train=preset(name))
    return Arguments(preset=cast(Any, name), config=config)


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --small and --area are both given."""
    from nvsim.building import BuildingConfig, generate
    from nvsim.cli.summary import summary
    from nvsim.evaluation.graph import evaluate_graph
    from nvsim.evaluation.truth import maps_in_aligned_frame

    if arguments.small and arguments.area:
        raise InputError("--small and --area give different buildings; name only one of them.")
    size: Literal["full", "small", "halls"] = "halls" if arguments.area else "small" if arguments.small else "full"
    options = {"storeys": arguments.storeys, "style": arguments.style, "area": arguments.area}
    config = BuildingConfig(arguments.seed, size, **cast(Any, options))
    with working(arguments.project, "demo", arguments.json, create=True) as (project, listen):
        generate(project.layout.root, config, listen)
        capture = project.layout.built_in_capture
        pipeline.run(project, capture, CaptureConfig(), arguments.config, listen, arguments.depth)
        built, layout = project.need_capture(), project.layout
        truth = maps_in_aligned_frame(layout.true_map or layout.ground_truth, built, "aligned")
        support = project.support()
        seen = None if support is None else support.at
        figures = evaluate_graph(project.need_graph(), truth, built.positions, seen=seen)
        project.set_result("graph", figures)
        end = [] if arguments.json else summary(project)
    say(*end)
    return window.offer(arguments.project, wanted=not arguments.no_window)
