"""Commands of the stages of a project: submaps, depth, floors, training, map, and earlier results."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, cast

import tyro

from nvsim.cli import terminal
from nvsim.cli.arguments import Inline, Memory, Positional, ProjectArguments, memory_budget, value_of_flag
from nvsim.cli.session import project_job
from nvsim.cli.terminal import print_lines
from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.depth.config import DepthConfig
from nvsim.errors import InputError
from nvsim.events import Done, Listener, Log, Warning
from nvsim.mapping.config import MappingConfig
from nvsim.mapping.families import NETWORK_NORMAL, NormalSource, with_normals
from nvsim.project.config import DepthUse, FloorsConfig
from nvsim.project.work import StageName
from nvsim.submaps.split import SubmapConfig, table_rows
from nvsim.training.config import Preset, TrainingConfig, at_paper_scale, preset


@dataclass(frozen=True)
class Submaps(ProjectArguments):
    """Split the trajectory into overlapping submaps. Prints a table and draws pictures/submaps.png in the project."""

    config: Inline[SubmapConfig] = field(default_factory=SubmapConfig)

    def run(self) -> int:
        from nvsim.project.stages import submaps

        with project_job(self.project, "submaps", self.json) as (project, listen):
            result = submaps.run(project, self.config, listen)
            rows = table_rows(result, project.need_capture().positions)
        if not self.json:
            terminal.table(list(rows[0]), [list(row.values()) for row in rows], "submaps")
        return 0


@dataclass(frozen=True)
class Depth(ProjectArguments):
    """Estimate dense depth from the images and their poses, and fuse it into a point cloud that replaces a LiDAR scan.
    If the capture has a LiDAR scan, nothing is done unless you request it."""

    depth: DepthUse = "auto"
    """auto: only if the capture has no LiDAR scan; always: also fills holes of one, never overrides it; or never."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[DepthConfig] = field(default_factory=DepthConfig)

    def run(self) -> int:
        from nvsim.project.stages import depths

        cluster = self.cluster
        with open_executor(cluster) as executor, project_job(self.project, "depth", self.json) as (project, listen):
            depths.run(project, self.depth, self.config, listen, executor)
        return 0


@dataclass(frozen=True)
class Floors(ProjectArguments):
    """Find the floor in every frame: floor heights, a mask per frame, and the floor area that all masks support."""

    discard_corrections: bool = False
    """Discard masks that were corrected by hand. Without this option they are kept and take precedence."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[FloorsConfig] = field(default_factory=FloorsConfig)

    def run(self) -> int:
        from nvsim.project.stages import floors

        cluster = self.cluster
        with open_executor(cluster) as executor, project_job(self.project, "floors", self.json) as (project, listen):
            floors.run(project, listen, self.discard_corrections, self.config, executor)
        return 0


@dataclass(frozen=True)
class Train(ProjectArguments):
    """Train the floor-aware Gaussian model of each submap. An interrupted training continues from its checkpoint."""

    submaps: tuple[int, ...] = ()
    """Submaps to train. Default: all."""
    at_once: int = 0
    """Number of submaps to train in parallel, each with its share of the cores; 0 decides by cores and free memory."""
    preset: Preset = "nvsim"
    """The values that the other options start from: NVSim's defaults, the paper's, or those of one of its baselines."""
    paper_scale: bool = False
    """Train models as large as the paper's: 30,000 steps, images of full size, a million Gaussians per submap, networks
    of full size. Needs a CUDA GPU to finish within a day."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[TrainingConfig] = field(default_factory=TrainingConfig)

    @staticmethod
    def defaults(argv: list[str]) -> Train:
        name = value_of_flag(argv, "--preset", "nvsim")
        config = at_paper_scale(preset(name)) if "--paper-scale" in argv else preset(name)
        return Train(cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)

    def run(self) -> int:
        from nvsim.project.stages import trained

        cluster = self.cluster
        with open_executor(cluster) as executor, project_job(self.project, "train", self.json) as (project, listen):
            trained.run(project, self.config, listen, self.submaps, self.at_once, executor)
        return 0


FALLS_BACK = (
    "No network of surface normals is installed. The map uses the Gaussians' normals, which contain 1 - alpha, "
    "instead of the paper's network."
)


def paper_map_config() -> MappingConfig:
    """The paper's map configuration, with normals of a network if one is installed."""
    from nvsim.perception.normals_network import normals_model

    config = MappingConfig.paper()
    return config if normals_model() is None else with_normal_source(config, "network")


def with_normal_source(config: MappingConfig, source: NormalSource) -> MappingConfig:
    """`config` with the normals that the option names among its criteria."""
    return replace(config, criteria=with_normals(config.criteria, source))


def report_network_fallback(config: MappingConfig, source: NormalSource, listen: Listener) -> None:
    """Reports that the paper's map is built without the network, unless the user chose this."""
    from nvsim.perception.normals_network import normals_model

    falls = "normal" in config.criteria and NETWORK_NORMAL not in config.criteria
    if falls and source == "criteria" and normals_model() is None:
        listen(Log(FALLS_BACK, "map"))


@dataclass(frozen=True)
class Map(ProjectArguments):
    """Search the trained models breadth-first and build the navigation graph, with evidence for every direction."""

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

    @staticmethod
    def defaults(argv: list[str]) -> Map:
        name = value_of_flag(argv, "--preset", "paper" if "--paper" in argv else "nvsim")
        config = paper_map_config() if name == "paper" else MappingConfig()
        return Map(cast(Path, tyro.MISSING), preset=cast(Any, name), config=config)

    def run(self) -> int:
        from nvsim.project.outdated import outdated_sentences
        from nvsim.project.stages import mapped

        budget = memory_budget(self.memory)
        config = with_normal_source(self.config, self.normal_source)
        with project_job(self.project, "map", self.json) as (project, listen):
            if self.preset == "paper":
                report_network_fallback(config, self.normal_source, listen)
            if old := outdated_sentences(project, until="train"):
                listen(Warning(" ".join(old), mapped.STAGE))
            mapped.run(project, config, listen, self.reapply, budget, self.backend)
        return 0


@dataclass(frozen=True)
class Restore:
    """Restore the earlier result of a stage, or undo such a restore. Without a stage, list the stored results."""

    project: Path
    """The project folder."""
    stage: Positional[Literal["", StageName]] = ""
    """The stage whose earlier result is restored. Results of later stages are not changed."""
    discard: bool = False
    """Delete the stored result to free disk space. The result in use is kept."""
    json: bool = False
    """Print events as JSON lines, or the list as JSON."""

    def run(self) -> int:
        """Runs the command. Raises InputError if the stage is missing or has no stored result."""
        from nvsim.project.earlier_results import discard, megabytes, restore

        if not self.stage:
            return _list(self)
        with project_job(self.project, "restore", self.json) as (project, listen):
            if self.discard:
                freed = discard(project, self.stage)
                listen(Done("restore", f"earlier result of {self.stage} deleted, {megabytes(freed)} freed", {}))
            else:
                words = restore(project, self.stage)
                listen(Done("restore", f"{words} in use again; run the command again to undo this", {}))
        return 0


def _list(arguments: Restore) -> int:
    from nvsim.project.earlier_results import kept_results, megabytes
    from nvsim.project.project import Project

    if arguments.discard:
        raise InputError("Name the stage whose earlier result to discard: nvsim restore STAGE --discard.")
    with Project.open(arguments.project) as project:
        kept = kept_results(project)
    if arguments.json:
        print_lines(terminal.as_json([asdict(k) for k in kept]))
    elif kept:
        terminal.table(
            ["stage", "earlier result", "size"], [[k.stage, k.words, megabytes(k.bytes)] for k in kept], "results"
        )
    else:
        print_lines("There is no earlier result yet; a stage stores one when it runs again.")
    return 0
