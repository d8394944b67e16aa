"""Make a VLN benchmark from a project: a scan for agents, features of its views, tasks with instructions, and the table
of the baselines, in one folder with a README. Run the same command again to continue an interrupted export."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from nvsim.cli.arguments import Inline, ProjectArguments
from nvsim.cli.console import listening
from nvsim.cli.terminal import say
from nvsim.r2r.features.layouts import Name
from nvsim.r2r.tasks.shortest import Bounds
from nvsim.r2r.tasks.splitting import Amounts


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    out: Path = Path("dataset")
    """The output folder: a new one, or one that this command wrote."""
    also: tuple[Path, ...] = ()
    """More projects, each of which becomes a scan of the dataset."""
    features: tuple[Name, ...] = ("vit-b16",)
    """Feature layouts, see `nvsim export features`."""
    projection: bool = False
    """Use a fixed projection of colors and edges as features, even if a network is available."""
    views: bool = False
    """Also write the 36 views of every viewpoint as images, for MapGPT."""
    size: int = 512
    """Pixels per side of a skybox face, a multiple of 16."""
    stub: bool = True
    """Write a stub of the scan ZMojNkEp431, which VLN-DUET and Recurrent-VLN-BERT open by name."""
    instructions: int = 3
    """Number of instructions per path."""
    landmarks: bool = True
    """Name doorways, corridors, objects and the floor in instructions."""
    vlnce: bool = False
    """Also write the tasks as VLN-CE episodes."""
    streamvln: bool = False
    """Also write the tasks as StreamVLN annotations."""
    unseen: tuple[str, ...] = ()
    """Scans that only val_unseen enters, as a whole. Default: a region of every scan."""
    amounts: Inline[Amounts] = field(default_factory=Amounts)
    bounds: Inline[Bounds] = field(default_factory=Bounds)
    force: bool = False
    """Also write graphs that R2R agents cannot handle."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """Renderer: gsplat if it is installed and there is a CUDA GPU, else the CPU kernels."""
    dry_run: bool = False
    """Report the files to write, their size and the time, or the reason why it is not possible; write nothing."""


def run(arguments: Arguments) -> int:
    from nvsim.dataset.building import DatasetOptions, export_dataset, prepared
    from nvsim.dataset.estimate import estimate_dataset
    from nvsim.dataset.tasks import TaskOptions
    from nvsim.r2r.observations.layout import ScanSettings

    a = arguments
    tasks = TaskOptions(a.unseen, a.instructions, a.landmarks, a.vlnce, a.streamvln, a.amounts, a.bounds)
    options = DatasetOptions(
        ScanSettings(size=a.size, views=a.views), a.stub, a.features, a.projection, tasks, a.force, a.backend
    )
    projects = (a.project, *a.also)
    if a.dry_run:
        with prepared(projects, a.out, options) as sources:
            _foretell(estimate_dataset(sources, options), a)
        return 0
    with listening(a.json) as listen:
        about = export_dataset(projects, a.out, options, listen)
    if not a.json:
        _show(about, a.out)
    return 0


def _foretell(found: dict[str, Any], a: Arguments) -> None:
    from nvsim.cli import show
    from nvsim.r2r.observations.estimate import size_words

    if a.json:
        say(show.as_json(found))
        return
    rows = [(k["what"], k["folder"] or ".", k["files"], size_words(k["bytes"])) for k in found["kinds"]]
    show.table(("files", f"in {a.out}", "number", "size"), rows)
    paths = ", ".join(f"{count} of {split}" for split, count in found["paths"].items())
    say(f"{found['drawn']} viewpoints, {found['todo']} of them still to be rendered; paths: {paths}.")
    say(f"About {size_words(found['bytes'])} in {found['files']} files; takes {found['time']}.")
    say(found["shortage"] or f"{size_words(found['free'])} of disk space are free.")


def _show(about: dict[str, Any], out: Path) -> None:
    from nvsim.evaluation.navigation import text_of

    said = about["tasks"]["instructions"]
    for split, agents in about["baselines"].items():
        say(split, *text_of(agents).split("\n"))
    say(f"From the instructions alone a follower finds {said['found_again']} of {said['paths']} paths.")
    say(f"Wrote {out}; its README.md describes the dataset.")
