"""The items of `R2R_<split>.json`: paths with instructions that an agent must follow.

Format: an array of {distance, scan, path_id, path, heading, instructions} (bringmeaspoon.org, R2R 1.0). Files of joined
paths, `R4R_<split>.json`, have four more keys. Unknown keys are ignored.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import read_json
from nvsim.graph.connectivity import is_name, json_number

_IDS = 1 << 53  # every JSON reader represents smaller integers exactly


@dataclass(frozen=True)
class Task:
    """A path and its instructions.

    path_id       unique over all splits and scans
    scan          scan id
    path          viewpoint ids from the start to the goal
    heading       radians at the start, 0 is +y, positive turns right
    instructions  texts for an agent; each is a separate episode
    distance      length of the path in meters, None if the file has none (R2R's test split)
    """

    path_id: int
    scan: str
    path: tuple[str, ...]
    heading: float
    instructions: tuple[str, ...] = ()
    distance: float | None = None

    @property
    def instr_ids(self) -> tuple[str, ...]:
        """The ids of the episodes, PATHID_0, PATHID_1 and so on.

        A path without instructions has one episode, for agents that read no instructions.
        """
        return tuple(f"{self.path_id}_{k}" for k in range(max(1, len(self.instructions))))


@dataclass(frozen=True)
class JoinedTask(Task):
    """Two paths of a split with the shortest path between them. The whole is usually not a shortest path.

    first_path_id, second_path_id   ids of the two paths
    shortest_path                   viewpoint ids of the shortest path from the start to the goal
    shortest_path_distance          its length in meters

    Source: R4R, Jain et al. 2019, Stay on the Path, section 4.
    """

    first_path_id: int = 0
    second_path_id: int = 0
    shortest_path: tuple[str, ...] = ()
    shortest_path_distance: float = 0.0


def write_tasks(path: Path, tasks: Iterable[Task]) -> Path:
    """Writes one task per line. Raises InputError if writing fails."""
    lines = ",\n".join(json.dumps(_item(task)) for task in tasks)
    atomic.write_text(path, f"[\n{lines}\n]\n" if lines else "[]\n")
    return path


def read_tasks(path: Path) -> list[Task]:
    """Reads the tasks of a file.

    Raises InputError with the item if the file is unreadable, a field is invalid, or a path_id occurs twice.
    """
    items = read_json(path, "an R2R tasks file", "name an R2R_<split>.json")
    if not isinstance(items, list):
        raise InputError(f"{path} is not a list of paths; name an R2R_<split>.json.")
    tasks, ids = [], set()
    for i, item in enumerate(items):
        task = _task(item, f"{path}, item {i}")
        if task.path_id in ids:
            raise InputError(f"{path}, item {i}: path_id {task.path_id} occurs twice; give every path its own path_id.")
        ids.add(task.path_id)
        tasks.append(task)
    return tasks


def _item(task: Task) -> dict[str, Any]:
    values = asdict(task)
    if task.distance is None:
        del values["distance"]
    return values


def _task(item: Any, where: str) -> Task:
    if not isinstance(item, dict):
        raise InputError(f"{where} is not an object; every path needs scan, path_id, path, heading and instructions.")
    path_id, scan, path = item.get("path_id"), item.get("scan"), item.get("path")
    if not isinstance(path_id, int) or isinstance(path_id, bool) or not 0 <= path_id < _IDS:
        raise InputError(f"{where}: path_id is {value_text(path_id)}; it must be a whole number from 0 to {_IDS - 1}.")
    if not is_name(scan):
        raise InputError(f"{where}: scan is {value_text(scan)}; it must be the id of a scan.")
    if not isinstance(path, list) or not path or not all(map(is_name, path)):
        raise InputError(f"{where}: path is {value_text(path)}; it must be a list of viewpoint ids.")
    instructions = item.get("instructions", [])
    if not isinstance(instructions, list) or not all(isinstance(text, str) for text in instructions):
        raise InputError(f"{where}: instructions is {value_text(instructions)}; it must be a list of texts.")
    heading = json_number(item.get("heading"), f"{where}: heading")
    distance = json_number(item["distance"], f"{where}: distance") if "distance" in item else None
    return Task(path_id, scan, tuple(path), heading, tuple(instructions), distance)
