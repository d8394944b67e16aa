"""Commands that measure images, masks, depth and scans of a project, and its ablation."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from nvsim.cli import terminal
from nvsim.cli.arguments import Positional, ProjectArguments
from nvsim.cli.console import event_listener
from nvsim.cli.session import project_job
from nvsim.cli.terminal import as_json, print_lines
from nvsim.errors import InputError
from nvsim.events import Done
from nvsim.files import atomic
from nvsim.networks.installed import BUNDLED


@dataclass(frozen=True)
class EvaluateViews(ProjectArguments):
    """Measure PSNR, SSIM and LPIPS of held-out frames at full size, with and without the floor.

    Takes about 0.1 seconds per frame of 640x480 pixels on two cores, and three times the duration of an LPIPS network.
    """

    truth: Path | None = None
    """Folder with floor/ (and transient/) masks named like the frames. Default: the project's own masks."""
    novel: bool = False
    """Also score the novel views of the ground truth (holdout_frames.txt, novel/): away from the trajectory and with
    other headings."""
    lpips: Path | None = None
    """An ONNX export of LPIPS. Default: lpips.onnx in the models folder ($NVSIM_MODELS)."""
    lpips_range: Literal["auto", "-1..1", "0..1"] = "auto"
    """Range of that network's input values. auto: as its metadata input_range says, else -1..1."""
    csv: Path | None = None
    """Write the metrics of every frame, every submap and their mean into this file."""
    pictures: Path | None = None
    """Folder for side-by-side images: frame, render, alpha."""

    def run(self) -> int:
        from nvsim.evaluation.scores import open_lpips
        from nvsim.evaluation.views import evaluate_views
        from nvsim.project.project import Project

        distance, why = open_lpips(self.lpips, self.lpips_range)
        with Project.open(self.project) as project, event_listener(False) as listen:
            result = evaluate_views(project, self.truth, self.pictures, listen, distance=distance, novel=self.novel)
        result["lpips_why"] = why
        if self.csv is not None:
            atomic.write_text(self.csv, _views_csv(result))
        print_lines(*([as_json(result)] if self.json else _views_text(result).split("\n")))
        return 0


def _views_text(result: dict[str, Any]) -> str:
    from nvsim.evaluation import table

    columns = [table.Column("submap", "submap"), table.Column("frames", "frames", decimals=0)]
    columns += [*table.WITH_FLOOR, *table.WITHOUT_FLOOR, *table.FLOOR_ONLY, *table.ALPHA]
    if "novel_views" in result:
        columns += table.NOVEL
    rows = [{**figures, "submap": str(s)} for s, figures in result["submaps"].items()]
    text = table.text_table(columns, [*rows, {**result, "submap": "mean"}])
    notes = [f"LPIPS is empty: {result['lpips_why']}."] if result["lpips_why"] else []
    if result["psnr_floor_constant"] is not None:
        notes.append(f"A floor in its best single color would get {result['psnr_floor_constant']:.2f} dB.")
    if "novel_views" in result and result["novel_alpha_floor"] is None:
        notes.append("Alpha on the floor of novel views is empty: the ground truth has no novel_floor/ masks.")
    return "\n".join([text, *notes])


def _views_csv(result: dict[str, Any]) -> str:
    from nvsim.evaluation.table import csv_table

    rows = [{**r, "part": "frame"} for r in result["per_frame"]]
    rows += [{**r, "part": "novel view"} for r in result.get("per_novel_view", [])]
    rows += [{**figures, "part": "submap", "submap": s} for s, figures in result["submaps"].items()]
    rows.append({**{k: v for k, v in result.items() if not isinstance(v, dict | list)}, "part": "mean"})
    first = ("part", "submap", "frame", "view", "frames")
    names = [n for n in dict.fromkeys(k for r in rows for k in r) if n not in (*first, "truth", "lpips_why")]
    return csv_table([*first, *names], rows)


@dataclass(frozen=True)
class EvaluateFloor(ProjectArguments):
    """Measure the mean IoU of the project's floor masks with true masks, over frames with at least 1 % true floor. Also
    measures the semantic network, the normals network, and their hybrid alone (iou_semantic, iou_normals, iou_hybrid,
    and iou_masks for the project's masks on the frames used)."""

    truth: Path | None = None
    """Folder with floor/ masks named like the frames. Default: the built-in building's own."""
    from_scan: bool = False
    """Use labels from the project's own point cloud as ground truth. Pixels without a label do not count."""
    cues: int = 48
    """Number of frames, evenly spread over the trajectory, on which each cue is measured; 0 for none."""
    semantic: str = BUNDLED
    """The semantic network among the cues."""
    normals: str = BUNDLED
    """The normals network among the cues."""

    def run(self) -> int:
        """Runs the command. Raises InputError if --cues is negative."""
        from nvsim.evaluation.floor import evaluate_project_floor
        from nvsim.project.project import Project

        if self.cues < 0:
            raise InputError(f"--cues {self.cues} is not a number of frames; give 0 or more.")
        with Project.open(self.project) as project, event_listener(False) as listen:
            result = evaluate_project_floor(
                project, self.truth, self.from_scan, self.cues, self.semantic, self.normals, listen
            )
        terminal.figures(result, self.json, "floor masks")
        return 0


@dataclass(frozen=True)
class EvaluateNormals(ProjectArguments):
    """Measure the mean angle between a network's normals and the true normals, on photographs or on renders."""

    truth: Path | None = None
    """Folder with floor/ and normals/ named like the frames, normals as (n + 1) * 127.5 in the world, black if unknown.
    Default: the built-in building's own."""
    from_scan: bool = False
    """Use labels from the project's own point cloud as ground truth."""
    of: Literal["photographs", "renders"] = "photographs"
    """Images to use. Renders are made from the cameras of the frames."""
    normals: str = BUNDLED
    """The network: a model's name (see nvsim models)."""
    frames: int = 60
    """Largest number of frames, evenly spread over the trajectory."""

    def run(self) -> int:
        """Runs the command. Raises InputError if --frames is not positive."""
        from nvsim.evaluation.normals import evaluate_project_normals
        from nvsim.project.project import Project

        if self.frames < 1:
            raise InputError(f"--frames {self.frames} is out of range; give 1 or more.")
        with Project.open(self.project) as project, event_listener(False) as listen:
            result = evaluate_project_normals(
                project, self.normals, self.of, self.truth, self.from_scan, self.frames, listen
            )
        terminal.figures(result, self.json, "normals")
        return 0


@dataclass(frozen=True)
class EvaluateDepth(ProjectArguments):
    """Compare the depth of the images with true depth: shares of pixels within 2, 5 and 10 percent, and covered
    share."""

    truth: Path | None = None
    """Folder of 16-bit PNGs in millimeters along the optical axis, 0 if unknown, named like the frames or by their
    number (000000.png). Default: the built-in building's own."""

    def run(self) -> int:
        from nvsim.evaluation.depth import evaluate_project_depth
        from nvsim.project.project import Project

        with Project.open(self.project) as project:
            result = evaluate_project_depth(project, self.truth)
        terminal.figures(result, self.json, "depth")
        return 0


@dataclass(frozen=True)
class EvaluateScan:
    """Check an exported scan: files, directions of the faces, reachable edges, seams, and views from its strips."""

    folder: Positional[Path]
    """The folder written by `nvsim export scan`."""
    scan: str | None = None
    """The scan to check, if the folder has several scans of NVSim."""
    project: Path | None = None
    """The project that it was exported from. Views are also rendered directly, and compared with those from strips."""
    views: int = 400
    """Number of views to compare."""
    json: bool = False
    """Print the results as JSON."""

    def run(self) -> int:
        """Returns 1 if the scan has problems. Raises InputError if --views is out of range."""
        from nvsim.evaluation.scan import evaluate_scan
        from nvsim.project.project import Project

        if not 1 <= self.views <= 100_000:
            raise InputError(f"{self.views} views cannot be compared; give --views from 1 to 100,000.")
        opened = nullcontext() if self.project is None else Project.open(self.project)
        with opened as project, event_listener(False) as listen:
            result = evaluate_scan(self.folder, self.scan, project, self.views, listen)
        terminal.figures(result, self.json, "scan")
        if not self.json:
            print_lines(*(result["problems"] or ["No problems found."]))
        return 1 if result["problems"] else 0


@dataclass(frozen=True)
class EvaluateAblation(ProjectArguments):
    """Train and print the paper's ablation table and the comparison of presets, with CSV files and images.

    Runs are stored in the project (ablation/). Both tables and later calls share them, and interrupted runs continue.
    The project's own models are not changed. The defaults need 7 runs per submap. The tables show the seconds of each
    run.
    """

    tables: tuple[Literal["ablation", "presets"], ...] = ("ablation", "presets")
    """Tables to make."""
    rows: tuple[Literal["base", "masking", "suppression", "floor", "ours"], ...] = ()
    """Only these rows of the ablation. Default: all."""
    presets: tuple[str, ...] = ()
    """Only these rows of the comparison. Default: all."""
    submaps: tuple[int, ...] = ()
    """Only these submaps. Default: all."""
    seeds: tuple[int, ...] = (0,)
    """Random seeds. With several, the table shows the mean and its standard deviation."""
    steps: int | None = None
    """Steps of every run. Default: as in the preset nvsim."""
    image_size: int | None = None
    """Longest side of the training images of every run, pixels. Default: as in the preset nvsim."""
    gaussian_cap: int | None = None
    """Largest number of Gaussians of every run. Default: as in the preset nvsim."""
    resume: bool = False
    """Continue the runs of an earlier call. This is the default, unless --repeat is given."""
    repeat: bool = False
    """Train every run again."""
    truth: Path | None = None
    """Folder with floor/ and transient/ masks and novel views. Default: the project's own ground truth."""
    lpips: Path | None = None
    """An ONNX export of LPIPS. Default: lpips.onnx in the models folder ($NVSIM_MODELS)."""
    lpips_range: Literal["auto", "-1..1", "0..1"] = "auto"
    """Range of that network's input values. auto: as its metadata input_range says, else -1..1."""
    out: Path | None = None
    """Folder for tables.txt, and a CSV file and an image per table. Default: ablation/ in the project."""

    def run(self) -> int:
        """Runs the command. Raises InputError if --resume and --repeat are both given."""
        from nvsim.evaluation.ablation import STAGE, AblationConfig, evaluate_ablation, text_of, write_report
        from nvsim.evaluation.ablation_runs import Budget, runs_folder
        from nvsim.evaluation.scores import open_lpips

        if self.resume and self.repeat:
            raise InputError("--resume and --repeat contradict each other; name one of them.")
        if self.out is not None:
            atomic.refuse_unwritable_folder(self.out)
        distance, why = open_lpips(self.lpips, self.lpips_range)
        budget = Budget(self.steps, self.image_size, self.gaussian_cap)
        config = AblationConfig(self.tables, self.rows, self.presets, self.submaps, self.seeds, budget, self.repeat)
        with project_job(self.project, "evaluate ablation", self.json) as (project, listen):
            outcome = evaluate_ablation(project, config, listen, self.truth, distance)
            files = write_report(outcome, self.out or runs_folder(project), why)
            results: dict[str, Any] = {
                "tables": {name: table.rows for name, table in outcome.tables.items()},
                "trained": outcome.trained,
                "reused": outcome.reused,
                "lpips_why": why,
                "files": [str(f) for f in files],
            }
            project.set_result("ablation", results)
            listen(Done(STAGE, f"{outcome.trained} runs trained, {outcome.reused} reused; {files[0].parent}", results))
        if not self.json:
            print_lines(*text_of(outcome, why).split("\n"))
        return 0
