"""Train and print the paper's ablation table and the comparison of presets, with CSV files and images.

Runs are stored in the project (ablation/). Both tables and later calls share them, and interrupted runs continue. The
project's own models are not changed. The defaults need 7 runs per submap. The tables show the seconds of each run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.session import working
from nvsim.cli.terminal import say


@dataclass(frozen=True)
class Arguments(ProjectArguments):
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
    """Continue the runs of an earlier call. This is the default, unless --afresh is given."""
    afresh: bool = False
    """Train every run again."""
    truth: Path | None = None
    """Folder with floor/ and transient/ masks and novel views. Default: the project's own ground truth."""
    lpips: Path | None = None
    """An ONNX export of LPIPS. Default: lpips.onnx in the models folder ($NVSIM_MODELS)."""
    lpips_range: Literal["auto", "-1..1", "0..1"] = "auto"
    """Range of that network's input values. auto: as its metadata input_range says, else -1..1."""
    out: Path | None = None
    """Folder for tables.txt, and a CSV file and an image per table. Default: ablation/ in the project."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if --resume and --afresh are both given."""
    from nvsim.errors import InputError
    from nvsim.evaluation.ablation import STAGE, AblationConfig, evaluate_ablation
    from nvsim.evaluation.ablation_report import text_of, write_report
    from nvsim.evaluation.ablation_runs import Budget, runs_folder
    from nvsim.evaluation.lpips import open_lpips
    from nvsim.events import Done

    a = arguments
    if a.resume and a.afresh:
        raise InputError("--resume and --afresh contradict each other; name one of them.")
    distance, why = open_lpips(a.lpips, a.lpips_range)
    budget = Budget(a.steps, a.image_size, a.gaussian_cap)
    config = AblationConfig(a.tables, a.rows, a.presets, a.submaps, a.seeds, budget, a.afresh)
    with working(a.project, "evaluate ablation", a.json) as (project, listen):
        outcome = evaluate_ablation(project, config, listen, a.truth, distance)
        files = write_report(outcome, a.out or runs_folder(project), why)
        results: dict[str, Any] = {
            "tables": {name: table.rows for name, table in outcome.tables.items()},
            "trained": outcome.trained,
            "reused": outcome.reused,
            "lpips_why": why,
            "files": [str(f) for f in files],
        }
        project.set_result("ablation", results)
        listen(Done(STAGE, f"{outcome.trained} runs trained, {outcome.reused} reused; {files[0].parent}", results))
    if not a.json:
        say(*text_of(outcome, why).split("\n"))
    return 0
