"""The card of a dataset: README.md, for those who get the folder."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nvsim.evaluation.navigation import text_of

_FOLDERS = {
    "scans": "Matterport's layout: set it as the simulator's dataset path, and `scans/connectivity` as that of the "
    "navigation graphs",
    "features": "of the 36 views of every viewpoint, as agents read them",
    "tasks": "`R2R_SPLIT.json` with paths and instructions; `tasks.json` says how they were made, `surroundings.json` "
    "what things the instructions mean",
    "results": "trajectories of the baselines, as for the R2R leaderboard",
}


def card_of(about: Mapping[str, Any]) -> str:
    """What dataset.json says, for people."""
    scans, tasks, features = about["scans"], about["tasks"], about["features"]
    said = tasks["instructions"]
    lines = [
        f"# {', '.join(scans)}: a benchmark for vision-and-language navigation",
        "",
        f"Made by {about['made_by']} with `nvsim export dataset`, from images of real or rendered buildings.",
        "",
        "| scan | viewpoints | edges |",
        "|---|---|---|",
        *(f"| {name} | {scan['viewpoints']} | {scan['edges']} |" for name, scan in scans.items()),
        "",
        "| split | paths | instructions |",
        "|---|---|---|",
        *(f"| {name} | {count} | {count * said['each']} |" for name, count in tasks["paths"].items()),
        "",
        "val_unseen has regions of the buildings to itself, which no path of train or val_seen enters, or whole scans.",
        "",
        "## Instructions",
        "",
        f"Each path has {said['each']}, made from the geometry of the graph"
        + (" and from what is seen along it" if said["landmarks_in"] else "")
        + f"; nobody spoke them. A follower that knows the graph, the start and what is said finds "
        f"{said['found_again']} of {said['paths']} paths again.",
        "",
        "## In the folder",
        "",
        *(f"- `{name}/`: {words}." for name, words in _FOLDERS.items() if name != "features" or features),
    ]
    for one in features:
        lines.append(f"  `features/{one['file']}` by {one['backbone']}, in the layout that {one['read_by']} read.")
    if tasks["episodes"]:
        count = sum(tasks["episodes"].values())
        lines.append(
            f"- `tasks/vlnce/`, `tasks/streamvln/` where they were asked for: {count} paths as actions of 0.25 m and "
            "15 degrees, for a robot of 0.25 m radius."
        )
    lines += ["", "## Baselines", ""]
    for split, agents in about["baselines"].items():
        lines += [f"{split}:", "", "```", text_of(agents).rstrip(), "```", ""]
    lines += [
        "Again: `nvsim evaluate r2r --scans scans --tasks tasks/R2R_val_unseen.json --agents shortest random`.",
        "",
    ]
    return "\n".join(lines)
