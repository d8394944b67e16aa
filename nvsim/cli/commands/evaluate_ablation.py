"""Train and print the paper's ablation table and the comparison of the presets, with CSV files and images.

Runs are kept in the project (ablation/), shared by both tables and by later calls, and continued where they were cut
off; the project's own models stay as they are. With the defaults there are 7 runs for each submap; the tables say how
many seconds each took."""

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
    """Which of the two."""
    rows: tuple[Literal["base", "masking", "suppression", "floor", "ours"], ...] = ()
    """Only these rows of the ablation."""
    presets: tuple[str, ...] = ()
    """Only these rows of the comparison."""
    submaps: tuple[int, ...] = ()
    """Only these submaps."""
    seeds: tuple[int, ...] = (0,)
    """With several the table shows the mean and its standard deviation."""
    steps: int | None = None
    """Steps of every run; as the preset nvsim has it when left out."""
    image_size: int | None = None
    """Longest side of the training images of every run, pixels; likewise."""
    gaussian_cap: int | None = None
    """Most Gaussians of every run; likewise."""
    resume: bool = False
    """Take up what an earlier call made. This is what happens anyway, unless --afresh."""
    afresh: bool = False
    """Train every run again."""
    truth: Path | None = None
    """Folder with floor/ and transient/ masks and novel views; the project's own when left out."""
    lpips: Path | None = None
    """An ONNX export of LPIPS; else lpips.onnx in the models folder ($NVSIM_MODELS)."""
    lpips_range: Literal["auto", "-1..1", "0..1"] = "auto"
    """The values that network takes; auto: as its property input_range says, else -1..1."""
    out: Path | None = None
    """Folder for tables.txt, a CSV file and an image per table; the project's ablation/ when left out."""


def run(arguments: Arguments) -> int:
    from nvsim.errors import InputError
    from nvsim.evaluation.ablation import STAGE, AblationConfig, evaluate_ablation
    from nvsim.evaluation.ablation_report import text_of, write_report
    from nvsim.evaluation.ablation_rows import Budget
    from nvsim.evaluation.ablation_run import runs_folder
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
        listen(Done(STAGE, f"{outcome.trained} runs trained, {outcome.reused} were there; {files[0].parent}", results))
    if not a.json:
        say(*text_of(outcome, why).split("\n"))
    return 0
