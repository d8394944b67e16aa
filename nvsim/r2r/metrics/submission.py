"""Trajectory files in the format of the R2R leaderboard: an array of {instr_id, trajectory}.

The trajectory is an array of [viewpoint id, heading, elevation], angles in radians. A turn on the spot repeats the
viewpoint. VLN-DUET and MapGPT write an array of segments instead, each an array of viewpoint ids; their angles are 0.
MapGPT writes a file for each instruction, with the item alone.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import read_json
from nvsim.graph.connectivity import is_name, json_number
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.tasks.task import Task

Pose = tuple[str, float, float]
"""Viewpoint id, heading and elevation in radians."""
Trajectories = Mapping[str, Sequence[Pose]]
"""instr_id -> the poses of an agent, from the start."""

_LARGEST = 1 << 30  # bytes
_CASES = "case_InstrID_*.json"
"""Files that MapGPT writes with --save_pred."""


def write_submission(path: Path, trajectories: Trajectories) -> Path:
    """Writes one trajectory per line. Raises InputError if writing fails."""
    items = ({"instr_id": id, "trajectory": poses} for id, poses in trajectories.items())
    atomic.write_text(path, "[\n" + ",\n".join(json.dumps(item) for item in items) + "\n]\n")
    return path


def read_submission(path: Path) -> dict[str, list[Pose]]:
    """Reads a trajectory file, or a folder with a file for each instruction, as MapGPT writes them. Raises InputError
    with the item if it is invalid or an instr_id occurs twice."""
    found: dict[str, list[Pose]] = {}
    for where, item in _items(path):
        if not isinstance(item, dict) or not isinstance(item.get("instr_id"), str):
            raise InputError(f"{where} has no instr_id; every item needs instr_id and trajectory.")
        id, poses = item["instr_id"], item.get("trajectory")
        where += f" ({value_text(id)})"
        if id in found:
            raise InputError(f"{where}: this instr_id occurs twice; give one trajectory for each.")
        found[id] = read_poses(poses, where)
    return found


def _items(path: Path) -> Iterator[tuple[str, Any]]:
    """The place and the content of each item."""
    then = "name a trajectory file in the leaderboard's format"
    if path.is_dir():
        files = sorted(path.glob(_CASES))
        if not files:
            raise InputError(f"{path} is a folder without results of MapGPT ({_CASES}); {then}.")
        yield from ((str(file), read_json(file, "a result of MapGPT", then, _LARGEST)) for file in files)
        return
    items = read_json(path, "a submission", then, _LARGEST)
    if not isinstance(items, list):
        raise InputError(f"{path} is not a list of trajectories; {then}, or the folder with the results of MapGPT.")
    yield from ((f"{path}, item {i}", item) for i, item in enumerate(items))


def read_poses(poses: Any, where: str) -> list[Pose]:
    """Parses a trajectory from JSON data. Raises InputError if it is invalid; `where` names its place."""
    if not isinstance(poses, list) or not poses:
        raise InputError(f"{where}: trajectory is {value_text(poses)}; it must be a list that begins with the start.")
    found = [pose for k, step in enumerate(poses) for pose in _poses_of(step, f"{where}, step {k}")]
    if not found:
        raise InputError(f"{where}: the segments of the trajectory are empty; the first one must have the start.")
    return found


def check_submission(
    trajectories: Trajectories, tasks: Sequence[Task], distances: Mapping[str, Distances], where: object
) -> None:
    """Checks the trajectories of all instructions, and ignores other trajectories, as the leaderboard does.

    Raises InputError if a trajectory is missing, does not begin at the start, or leaves the graph. `where` names the
    source of the trajectories.
    """
    wanted = [(id, task) for task in tasks for id in task.instr_ids]
    missing = [id for id, _ in wanted if id not in trajectories]
    if missing:
        raise InputError(
            f"{where} lacks {len(missing)} of {len(wanted)} instructions, the first {missing[0]}; run the agent on the "
            "whole split."
        )
    for id, task in wanted:
        path = [pose[0] for pose in trajectories[id]]
        if path[0] != task.path[0]:
            raise InputError(
                f"{where}, {id}: the trajectory begins at {value_text(path[0])} and not at the start {task.path[0]}; "
                "write the start as its first step."
            )
        wrong = distances[task.scan].find_invalid_step(path)
        if wrong:
            raise InputError(f"{where}, {id}: {wrong}; write every viewpoint that the agent passes.")


def _poses_of(step: Any, where: str) -> list[Pose]:
    """A pose, or the poses of a segment of viewpoint ids."""
    is_segment = isinstance(step, list) and all(map(is_name, step))
    return [(id, 0.0, 0.0) for id in step] if is_segment else [_pose(step, where)]


def _pose(pose: Any, where: str) -> Pose:
    if not isinstance(pose, list) or len(pose) != 3 or not is_name(pose[0]):
        raise InputError(
            f"{where} is {value_text(pose)}; it must be [viewpoint id, heading, elevation], or a list of viewpoint ids."
        )
    return pose[0], json_number(pose[1], f"{where}: heading"), json_number(pose[2], f"{where}: elevation")
