"""Commands that write data for agents: features, candidates, or a complete benchmark."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from nvsim.cli import terminal
from nvsim.cli.arguments import Inline, Positional, ProjectArguments
from nvsim.cli.commands.export_tasks import TaskArguments
from nvsim.cli.console import event_listener
from nvsim.cli.terminal import as_json, print_lines
from nvsim.cluster.config import ClusterConfig
from nvsim.cluster.executor_choice import open_executor
from nvsim.dataset.agent_files import AgentName
from nvsim.errors import InputError
from nvsim.events import Warning
from nvsim.networks.onnx_session import Provider
from nvsim.r2r.features.layouts import LAYOUTS, Name, missing_package_error


@dataclass(frozen=True)
class ExportFeatures:
    """Write features of the 36 views of every viewpoint of exported scans, in the files that agents read, with any ONNX
    network or the built-in features. Run it again to continue an interrupted run."""

    export: Positional[Path | None] = None
    """The folder of an export: connectivity/ with scans.txt, and views/ or skybox strips."""
    folder: Path | None = None
    """The folder of an export, as a named option. Default: `scans` next to the project."""
    project: Path | None = None
    """The project of the scan, if the command runs as a job of that project."""
    layout: tuple[Name, ...] = ("vit-b16",)
    """resnet-152: TSV of EnvDrop and Recurrent-VLN-BERT; vit-b16: HAMT and VLN-DUET; clip-b16: ScaleVLN and SAME;
    clip-h14: ScaleVLN; eva-l14: NaviLLM; eva-g: LMDB of NavGPT-2. You can name several."""
    model: Path | None = None
    """An ONNX network with a description next to it (CLIP.onnx, CLIP.toml). Default: features.LAYOUT.onnx in the models
    folder, else an ImageNet network (the extra `features`), else a fixed projection of colors and edges."""
    projection: bool = False
    """Use the fixed projection of colors and edges, even if a network is available."""
    out: Path | None = None
    """The output folder. Default: `features` in the export."""
    scans: tuple[str, ...] = ()
    """Scans to include. Default: all that scans.txt lists and that have images."""
    batch: int = 12
    """Number of images per batch of an ONNX network, if the network allows any number."""
    provider: Provider = "auto"
    """Device of an ONNX network: CUDA if onnxruntime supports it, else the CPU."""
    json: bool = False
    """Print events, one JSON object per line."""

    def run(self) -> int:
        """Runs the command. Raises InputError if options are invalid or contradict each other."""
        from nvsim.r2r.features.exported_scan import read_exported_scans
        from nvsim.r2r.features.extraction import STAGE, extract_layouts, with_images
        from nvsim.r2r.features.network import choose_backbone

        if not 1 <= self.batch <= 1024:
            raise InputError(f"--batch {self.batch} is out of range; give 1 to 1024.")
        for name in self.layout:
            if sentence := missing_package_error(LAYOUTS[name]):
                raise InputError(sentence)
        if self.model is not None and self.projection:
            raise InputError("--model and --projection exclude each other; give one.")
        if self.export is not None and self.folder is not None:
            raise InputError(f"The export is named twice, {self.export} and --folder {self.folder}; name it once.")
        export = self.export or self.folder or (self.project and self.project.absolute().parent / "scans")
        if export is None:
            raise InputError("No export is named; give the folder that `nvsim export scan` wrote.")
        written = []
        with event_listener(self.json) as listen:
            scans = with_images(read_exported_scans(export, self.scans), bool(self.scans), listen)
            chosen = []
            for name in dict.fromkeys(self.layout):
                backbone, warning = choose_backbone(
                    LAYOUTS[name], self.model, self.batch, self.provider, self.projection
                )
                if warning:
                    listen(Warning(warning, STAGE))
                chosen.append((LAYOUTS[name], backbone))
            for _, paths in extract_layouts(scans, chosen, self.out or export / "features", listen):
                written += paths
        if not self.json:
            print_lines(*(f"Wrote {path}" for path in written))
        return 0


@dataclass(frozen=True)
class ExportCandidates:
    """Write the files of agents that run without a simulator, from the connectivity of exported scans: candidates with
    view and angles, navigable neighbors and positions, as the JSON files of VLN-DUET, NavGPT, NavGPT-2 and SAME."""

    export: Positional[Path]
    """The folder of an export (which contains connectivity/), or a folder of connectivity files with scans.txt."""
    out: Path | None = None
    """The output folder. Default: `candidates` in the export."""
    scans: tuple[str, ...] = ()
    """Scans to include. Default: all that scans.txt lists."""
    json: bool = False
    """Print the written files as JSON."""

    def run(self) -> int:
        from nvsim.r2r.features.candidates import write_candidates
        from nvsim.r2r.features.exported_scan import read_exported_scans

        out = self.out or self.export / "candidates"
        written = write_candidates(read_exported_scans(self.export, self.scans), out)
        if written.unseen:
            scan, a, b = written.unseen[0]
            print_lines(
                f"warning: {len(written.unseen)} edges are vertical, so no view shows them and no file contains them "
                f"(the first in {scan} from {a} to {b}); move one end sideways with `nvsim graph edit`.",
                error=True,
            )
        if self.json:
            print_lines(
                as_json(
                    {
                        "written": [str(path) for path in written.paths],
                        "viewpoints": written.viewpoints,
                        "candidates": written.candidates,
                        "unseen": written.unseen,
                    }
                )
            )
        else:
            print_lines(*(f"Wrote {path}" for path in written.paths))
        return 0


@dataclass(frozen=True)
class ExportDataset(ProjectArguments):
    """Make a VLN benchmark from a project: a scan for agents, features of its views, tasks with instructions, and the
    table of the baselines, in one folder with a README. Run the same command again to continue an interrupted
    export."""

    out: Path = Path("dataset")
    """The output folder: a new one, or one that this command wrote."""
    also: tuple[Path, ...] = ()
    """More projects, each of which becomes a scan of the dataset."""
    for_: Annotated[tuple[AgentName, ...], tyro.conf.arg(name="for")] = ()
    """Agents whose folder to write, agents/NAME, with the files, names and keys that their scripts expect."""
    vocabulary: Path | None = None
    """The vocab.txt of bert-base-uncased, which VLN-DUET and VLN-HAMT need. Instructions are written as its word
    pieces."""
    features: tuple[Name, ...] | None = None
    """Feature layouts, see `nvsim export features`. --for adds those of its agents. Default: vit-b16, and with --for
    only those of the agents."""
    projection: bool = False
    """Use a fixed projection of colors and edges as features, even if a network is available."""
    views: bool = False
    """Also write the 36 views of every viewpoint as images, for MapGPT."""
    size: int = 512
    """Pixels per side of a skybox face, a multiple of 16."""
    stub: bool = True
    """Write a stub of the scan ZMojNkEp431, which VLN-DUET and Recurrent-VLN-BERT open by name."""
    tasks: Inline[TaskArguments] = field(default_factory=TaskArguments)
    force: bool = False
    """Also write graphs that R2R agents cannot handle."""
    backend: Literal["auto", "numba", "gsplat"] = "auto"
    """Renderer: gsplat if it is installed and there is a CUDA GPU, else the CPU kernels."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    dry_run: bool = False
    """Report the files to write, their size and the time, or the reason why it is not possible; write nothing."""

    @property
    def layouts(self) -> tuple[Name, ...]:
        """The feature layouts that are written even if no agent reads them."""
        if self.features is not None:
            return self.features
        return () if self.for_ else ("vit-b16",)

    def run(self) -> int:
        from nvsim.dataset.building import DatasetOptions, export_dataset, prepare_exports
        from nvsim.dataset.estimate import estimate_dataset
        from nvsim.r2r.observations.layout import ScanSettings

        options = DatasetOptions(
            ScanSettings(size=self.size, views=self.views),
            self.stub,
            self.layouts,
            self.projection,
            self.tasks,
            self.force,
            self.backend,
            tuple(dict.fromkeys(self.for_)),
            self.vocabulary,
        )
        projects = (self.project, *self.also)
        if self.dry_run:
            with prepare_exports(projects, self.out, options) as sources:
                _print_estimate(estimate_dataset(sources, options), self)
            return 0
        with event_listener(self.json) as listen, open_executor(self.cluster) as executor:
            about = export_dataset(projects, self.out, options, listen, executor)
        if not self.json:
            _show(about, self.out)
        return 0


def _print_estimate(found: dict[str, Any], a: ExportDataset) -> None:
    from nvsim.r2r.observations.estimate import size_words

    if a.json:
        print_lines(terminal.as_json(found))
        return
    rows = [(k["what"], k["folder"] or ".", k["files"], size_words(k["bytes"])) for k in found["kinds"]]
    terminal.table(("files", f"in {a.out}", "number", "size"), rows)
    paths = ", ".join(f"{count} of {split}" for split, count in found["paths"].items())
    print_lines(f"{found['drawn']} viewpoints, {found['todo']} of them still to be rendered; paths: {paths}.")
    print_lines(f"About {size_words(found['bytes'])} in {found['files']} files; takes {found['time']}.")
    print_lines(found["shortage"] or f"{size_words(found['free'])} of disk space are free.")


def _show(about: dict[str, Any], out: Path) -> None:
    from nvsim.evaluation.navigation import text_of

    said = about["tasks"]["instructions"]
    for split, agents in about["baselines"].items():
        print_lines(split, *text_of(agents).split("\n"))
    if said["each"]:
        print_lines(f"From the instructions alone a follower finds {said['found_again']} of {said['paths']} paths.")
    print_lines(f"Wrote {out}; its README.md describes the dataset.")
