"""Write a dataset as tables in JSON Lines, and the header of README.md from which Hugging Face `datasets` opens them.

`data/instructions_SPLIT.jsonl` has a row for each instruction, and `data/viewpoints.jsonl` one for each viewpoint. The
header skips splits without paths, because an empty table has no columns.

Source: huggingface.co/docs/hub/datasets-manual-configuration.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from nvsim.files import atomic
from nvsim.graph.types import NavGraph
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.tasks.task import Task

DATA = "data"
_SIZES = (1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M")


def write_tables(out: Path, scans: str, graphs: Sequence[NavGraph], splits: Mapping[str, Sequence[Task]]) -> list[Path]:
    """Writes the tables into `out`/data and returns their paths; `scans` is the folder of the scans in `out`.

    Raises InputError if writing fails.
    """
    files = {f"instructions_{split}": instruction_rows(tasks) for split, tasks in splits.items()}
    files["viewpoints"] = viewpoint_rows(out, scans, graphs)
    written = []
    for name, rows in files.items():
        written.append(out / DATA / f"{name}.jsonl")
        atomic.write_text(written[-1], "".join(json.dumps(row) + "\n" for row in rows))
    return written


def instruction_rows(tasks: Sequence[Task]) -> Iterator[dict[str, Any]]:
    """Yields a row for each instruction; `instruction` is empty for a path without instructions."""
    for task in tasks:
        for id, text in zip(task.instr_ids, task.instructions or ("",)):
            yield {
                "instr_id": id,
                "path_id": task.path_id,
                "scan": task.scan,
                "path": list(task.path),
                "heading": float(task.heading),
                "distance": task.distance,
                "instruction": text,
            }


def viewpoint_rows(out: Path, scans: str, graphs: Sequence[NavGraph]) -> Iterator[dict[str, Any]]:
    """Yields a row for each included viewpoint; the paths of its images begin in `out`."""
    for graph in graphs:
        neighbors: dict[str, list[str]] = {id: [] for id, v in graph.viewpoints.items() if v.included}
        for a, b in graph.edges:
            if a in neighbors and b in neighbors:
                neighbors[a].append(b)
                neighbors[b].append(a)
        places = ScanPlaces(out / scans, graph.scan)
        for id, beside in neighbors.items():
            viewpoint = graph.viewpoints[id]
            yield {
                "scan": graph.scan,
                "viewpoint": id,
                "position": [float(x) for x in viewpoint.position],
                "height": float(viewpoint.height),
                "neighbors": beside,
                "skybox": places.strip(id).relative_to(out).as_posix(),
                "depth": places.depth(id).relative_to(out).as_posix(),
            }


def header_of(about: Mapping[str, Any]) -> list[str]:
    """Returns the lines of the YAML header of README.md for the content of dataset.json."""
    tasks = about["tasks"]
    rows = sum(tasks["paths"].values()) * max(1, tasks["instructions"]["each"])
    size = next((name for most, name in _SIZES if rows < most), "n>1M")
    splits = [name for name, count in tasks["paths"].items() if count]
    return [
        "---",
        f"pretty_name: {json.dumps(', '.join(about['scans']))}",
        "language: [en]",
        "task_categories: [robotics]",
        "tags: [vision-and-language-navigation, embodied-ai, nvsim]",
        f"size_categories: [{json.dumps(size)}]",
        "configs:",
        "- config_name: instructions",
        "  default: true",
        "  data_files:",
        *(line for name in splits for line in _files(name, f"instructions_{name}")),
        "- config_name: viewpoints",
        "  data_files:",
        *_files("viewpoints", "viewpoints"),
        "---",
        "",
    ]


def _files(split: str, name: str) -> list[str]:
    return [f"  - split: {split}", f"    path: {DATA}/{name}.jsonl"]
