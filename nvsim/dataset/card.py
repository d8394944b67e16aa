"""Write the dataset card: a README.md for users of the dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nvsim.dataset.tables import header_of
from nvsim.evaluation.navigation import text_of
from nvsim.r2r.instructions.statistics import Statistics, table_of

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
        f"{said['found_again']} of {said['paths']} paths.",
        "",
        *(_statistics(said) if said["each"] else ()),
        "## Content of the folder",
        "",
        *(f"- `{name}/`: {words}." for name, words in _FOLDERS.items() if name not in _ON_REQUEST or about.get(name)),
    ]
    for one in features:
        lines.append(f"  `features/{one['file']}` by {one['backbone']}, in the layout that {one['read_by']} read.")
    if tasks["episodes"]:
        count = sum(tasks["episodes"].values())
        lines.append(
            f"- `tasks/vlnce/`, `tasks/streamvln/` if they were exported: {count} paths as actions of 0.25 m and "
            "15 degrees, for a robot with a radius of 0.25 m."
        )
    if about["options"]["tasks"].get("rxr"):
        lines.append("- `tasks/rxr/`: the instructions as guide annotations of RxR, with pose traces.")
    if about["options"]["tasks"].get("goals"):
        lines.append(
            "- `tasks/goals/`: PointNav, ObjectNav, and image goals for Habitat, and REVERIE's remote objects."
        )
    lines += ["", "## Baselines", ""]
    for split, agents in about["baselines"].items():
        lines += [f"{split}:", "", "```", text_of(agents).rstrip(), "```", ""]
    lines += [
        "To repeat: `nvsim evaluate r2r --scans scans --tasks tasks/R2R_val_unseen.json --agents shortest random`.",
        "",
    ]
    return "\n".join(lines)
