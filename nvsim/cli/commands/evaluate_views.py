"""PSNR, SSIM and LPIPS of the frames that were held out of training, at full size, with and without the floor.

About 0.1 seconds a frame of 640x480 pixels on two cores, and three times an LPIPS network's own."""

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
    """Folder with floor/ (and transient/) masks named like the frames; the project's own masks when left out."""
    novel: bool = False
    """Also the novel views of the truth (holdout_frames.txt, novel/): beside the trajectory, turned away from it."""
    lpips: Path | None = None
    """An ONNX export of LPIPS; else lpips.onnx in the models folder ($NVSIM_MODELS)."""
    lpips_range: Literal["auto", "-1..1", "0..1"] = "auto"
    """The values that network takes; auto: as its property input_range says, else -1..1."""
    csv: Path | None = None
    """Write the figures of every frame, every submap and their mean into this file."""
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
        notes.append(f"The floor painted in its best single colour would get {result['psnr_floor_constant']:.2f} dB.")
    if "novel_views" in result and result["novel_alpha_floor"] is None:
        notes.append("Alpha on the floor of novel views is empty: the truth has no novel_floor/ masks.")
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
