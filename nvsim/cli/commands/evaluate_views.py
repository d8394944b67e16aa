"""Measure PSNR, SSIM and LPIPS of held-out frames at full size, with and without the floor.

Takes about 0.1 seconds per frame of 640x480 pixels on two cores, and three times the duration of an LPIPS network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from nvsim.cli.arguments import ProjectArguments
from nvsim.cli.console import listening
from nvsim.cli.show import as_json
from nvsim.cli.terminal import say
from nvsim.project.project import Project


@dataclass(frozen=True)
class Arguments(ProjectArguments):
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


def run(arguments: Arguments) -> int:
    from nvsim.evaluation.lpips import open_lpips
    from nvsim.evaluation.views import evaluate_views
    from nvsim.files import atomic

    distance, why = open_lpips(arguments.lpips, arguments.lpips_range)
    with Project.open(arguments.project) as project, listening(False) as listen:
        result = evaluate_views(
            project, arguments.truth, arguments.pictures, listen, distance=distance, novel=arguments.novel
        )
    result["lpips_why"] = why
    if arguments.csv is not None:
        atomic.write_text(arguments.csv, _csv(result))
    say(*([as_json(result)] if arguments.json else _text(result).split("\n")))
    return 0


def _text(result: dict[str, Any]) -> str:
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


def _csv(result: dict[str, Any]) -> str:
    from nvsim.evaluation.table import csv_table

    rows = [{**r, "part": "frame"} for r in result["per_frame"]]
    rows += [{**r, "part": "novel view"} for r in result.get("per_novel_view", [])]
    rows += [{**figures, "part": "submap", "submap": s} for s, figures in result["submaps"].items()]
    rows.append({**{k: v for k, v in result.items() if not isinstance(v, dict | list)}, "part": "mean"})
    first = ("part", "submap", "frame", "view", "frames")
    names = [n for n in dict.fromkeys(k for r in rows for k in r) if n not in (*first, "truth", "lpips_why")]
    return csv_table([*first, *names], rows)
