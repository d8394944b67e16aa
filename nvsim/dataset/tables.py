"""Write a dataset as tables in JSON Lines, and its card: a README.md for users of the dataset.

`data/instructions_SPLIT.jsonl` has a row for each instruction, and `data/viewpoints.jsonl` one for each viewpoint. The
card begins with the header from which Hugging Face `datasets` opens them. The header skips splits without paths,
because an empty table has no columns.

Source: huggingface.co/docs/hub/datasets-manual-configuration.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from nvsim.evaluation.navigation import text_of
from nvsim.files import atomic
from nvsim.graph.types import NavGraph
from nvsim.r2r.instructions.statistics import Statistics, table_of
from nvsim.r2r.observations.layout import ScanPlaces
from nvsim.r2r.tasks.task import Task

DATA = "data"
_SIZES = (1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M")
_FOLDERS = {
    "scans": "scans in Matterport's layout: use this folder as the simulator's dataset path, and "
    "`scans/connectivity` as its path of navigation graphs",
    "features": "features of the 36 views of every viewpoint, in the formats that agents read",
    "data": "tables of the instructions and the viewpoints: `datasets.load_dataset(FOLDER)` of Hugging Face opens them",
    "tasks": "`R2R_SPLIT.json` with paths and instructions; `tasks.json` describes how they were made, and "
    "`surroundings.json` the objects that the instructions name",
    "candidates": "candidate neighbors of every viewpoint, for agents without a simulator",
    "frames": "what a robot sees before each action of the episodes",
    "scenes": "scenes for Habitat, which the episodes in small steps name",
    "agents": "folders with the files and names that the scripts of agents expect; each has a README.md",
    "results": "trajectories of the baselines, in the format of the R2R leaderboard",
}


_ON_REQUEST = ("features", "candidates", "frames", "scenes", "agents")


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
                "skybox": places.skyboxes.strip(id).relative_to(out).as_posix(),
                "depth": places.skyboxes.depth(id).relative_to(out).as_posix(),
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


def _statistics(said: Mapping[str, Any]) -> list[str]:
    rows = table_of(Statistics(**said["statistics"]), said["found_again"] / max(1, said["paths"]))
    return [
        f"Their register is `{said['register']}`. Statistics, beside those of 540 random human instructions of R2R:",
        "",
        "| | this dataset | R2R |",
        "|---|---|---|",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
    ]


def card_of(about: Mapping[str, Any]) -> str:
    """The text of README.md for the content of dataset.json."""
    scans, tasks, features = about["scans"], about["tasks"], about["features"]
    said = tasks["instructions"]
    lines = [
        *header_of(about),
        f"# {', '.join(scans)}: a benchmark for vision-and-language navigation",
        "",
        f"Made by {about['made_by']} with `nvsim export dataset` from images of real or rendered buildings.",
        "",
        "| scan | viewpoints | edges |",
        "|---|---|---|",
        *(f"| {name} | {scan['viewpoints']} | {scan['edges']} |" for name, scan in scans.items()),
        "",
        "| split | paths | instructions |",
        "|---|---|---|",
        *(f"| {name} | {count} | {count * said['each']} |" for name, count in tasks["paths"].items()),
        "",
        "val_unseen has its own regions of the buildings, which no path of train or val_seen enters, or whole scans.",
        "",
        "## Instructions",
        "",
        f"Each path has {said['each']} instructions, generated from the geometry of the graph"
        + (" and from objects along the path" if said["landmarks_in"] else "")
        + f"; no person wrote them. A follower that knows the graph, the start, and the instruction finds "
        f"{said['found_again']} of {said['paths']} paths."
        if said["each"]
        else "The paths have no instructions.",
        "",
        *(_statistics(said) if said["each"] else ()),
        "## Content of the folder",
        "",
    ]
    for name, words in _FOLDERS.items():
        if name not in _ON_REQUEST or about.get(name):
            lines.append(f"- `{name}/`: {words}.")
        if name == "features":
            lines += [f"  - `features/{f['file']}`: by {f['backbone']}, for {f['read_by']}" for f in features]
            if about.get("objects"):
                lines.append("  - `features/objects.hdf5` and `features/objects_corners.hdf5`: of the objects of goals")
    if tasks["episodes"]:
        count = sum(tasks["episodes"].values())
        lines.append(
            f"- `tasks/vlnce/`, `tasks/streamvln/` if they were exported: {count} paths as actions of 0.25 m and "
            "15 degrees, for a robot with a radius of 0.25 m."
        )
    if about["options"]["tasks"].get("rxr"):
        lines.append("- `tasks/rxr/`: the instructions as guide annotations of RxR, with pose traces.")
    if about["options"]["tasks"].get("goals"):
        goals = "PointNav, ObjectNav, and image goals for Habitat, and remote objects of REVERIE and SOON"
        lines.append(f"- `tasks/goals/`: {goals}.")
    lines += ["", "## Baselines", ""]
    for split, agents in about["baselines"].items():
        lines += [f"{split}:", "", "```", text_of(agents).rstrip(), "```", ""]
    tested = list(about["baselines"])
    if tested:
        agents = " ".join(name.lower() for name in about["baselines"][tested[-1]])
        tasks_file = f"tasks/R2R_{tested[-1]}.json"
        command = f"nvsim evaluate r2r --scans scans --tasks {tasks_file} --agents {agents}"
        seed = about["options"]["tasks"]["amounts"]["seed"]
        lines += [f"To repeat: `{command}{f' --seed {seed}' if seed else ''}`.", ""]
    return "\n".join(lines)
