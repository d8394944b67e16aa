"""A person's review of tasks: accepted, rejected and rewritten ones, and tasks that do not fit an edited graph.

A file stores the verdicts and the rewritten instructions, separate from the generated tasks. Format: {"format": 1,
"tasks": [{split, path_id, scan, state, instructions}]}. The state is "accepted", "rejected" or "". The instructions are
null if those of the task are unchanged.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nvsim.errors import InputError, value_text
from nvsim.files import atomic
from nvsim.files.opening import read_json
from nvsim.graph.paths import SAME_LENGTH
from nvsim.r2r.metrics.distances import Distances
from nvsim.r2r.metrics.scores import score
from nvsim.r2r.metrics.submission import Pose, Trajectories
from nvsim.r2r.tasks.task import JoinedTask, Task, read_tasks, write_tasks

FOLDER = "reviewed"
FILE = "tasks_review.json"
FORMAT = 1
STATES = ("", "accepted", "rejected")

Key = tuple[str, int, str]
"""Split, path_id and scan."""


@dataclass(frozen=True)
class Verdict:
    """A decision about a task.

    state         one of STATES
    instructions  the rewritten instructions, None if the generated ones are unchanged
    """

    state: str = ""
    instructions: tuple[str, ...] | None = None


class Review:
    """The verdicts about a folder of tasks, with undo."""

    def __init__(self, verdicts: Mapping[Key, Verdict] | None = None) -> None:
        self._verdicts = dict(verdicts or {})
        self._before: list[tuple[Key, Verdict]] = []

    def __getitem__(self, key: Key) -> Verdict:
        return self._verdicts.get(key, Verdict())

    def set_state(self, key: Key, state: str) -> None:
        """Sets the state of a verdict. Raises ValueError if `state` is not in STATES."""
        if state not in STATES:
            raise ValueError(f"{state!r} is none of {STATES}")
        self._store_verdict(key, replace(self[key], state=state))

    def set_instructions(self, key: Key, instructions: Iterable[str] | None) -> None:
        self._store_verdict(key, replace(self[key], instructions=None if instructions is None else tuple(instructions)))

    def undo(self) -> Key | None:
        """Reverts the last change since the review was opened. Returns the task's key, or None without a change."""
        if not self._before:
            return None
        key, verdict = self._before.pop()
        self._verdicts[key] = verdict
        return key

    def reviewed(self, key: Key, task: Task) -> Task:
        """Returns the task with its rewritten instructions, if there are any."""
        written = self[key].instructions
        return task if written is None else replace(task, instructions=written)

    def write(self, path: Path) -> None:
        """Writes the review. Raises InputError if writing fails."""
        rows = [
            {"split": split, "path_id": id, "scan": scan, "state": v.state, "instructions": v.instructions}
            for (split, id, scan), v in sorted(self._verdicts.items())
            if v != Verdict()
        ]
        atomic.make_folder(path.parent)
        atomic.write_text(path, json.dumps({"format": FORMAT, "tasks": rows}, indent=1) + "\n")

    def _store_verdict(self, key: Key, verdict: Verdict) -> None:
        if verdict != self[key]:
            self._before.append((key, self[key]))
            self._verdicts[key] = verdict


def read_review(path: Path) -> Review:
    """Reads a review; returns an empty one if there is no file. Raises InputError with the item if it is invalid."""
    if not path.exists():
        return Review()
    found = read_json(path, "a tasks review", "move it away to begin a new one")
    items = found.get("tasks") if isinstance(found, dict) and found.get("format") == FORMAT else None
    if not isinstance(items, list):
        raise InputError(f"{path} is not a tasks review of format {FORMAT}; move it away to begin a new one.")
    return Review(dict(_row(item, f"{path}, item {i}") for i, item in enumerate(items)))


def _row(item: Any, where: str) -> tuple[Key, Verdict]:
    if not isinstance(item, dict):
        raise InputError(f"{where} is {value_text(item)}; it must be an object with split, path_id, scan and state.")
    split, id, scan = item.get("split"), item.get("path_id"), item.get("scan")
    state, texts = item.get("state"), item.get("instructions")
    named = isinstance(split, str) and isinstance(id, int) and isinstance(scan, str)
    valid_texts = texts is None or (isinstance(texts, list) and all(isinstance(text, str) for text in texts))
    if not named or state not in STATES or not valid_texts:
        raise InputError(f"{where} is invalid ({value_text(item)}); correct it, or move the file away.")
    return (str(split), int(id), str(scan)), Verdict(str(state), None if texts is None else tuple(texts))  # type: ignore[arg-type]


@dataclass(frozen=True)
class TaskEntry:
    """A task and the name of its file without .json: `split` is R2R_train and so on."""

    split: str
    task: Task

    @property
    def key(self) -> Key:
        return self.split, self.task.path_id, self.task.scan


@dataclass(frozen=True)
class TaskFolder:
    """The tasks of a folder. `review_file` stores the verdicts about them."""

    review_file: Path
    entries: tuple[TaskEntry, ...]
    review: Review


def read_folder(*paths: Path) -> TaskFolder:
    """Reads tasks files of one folder, or a folder with R2R_*.json and R4R_*.json.

    Raises InputError if there is no file, one is unreadable, or they are in different folders.
    """
    found: list[Path] = []
    for path in paths:
        inside = sorted([*path.glob("R2R_*.json"), *path.glob("R4R_*.json")]) if path.is_dir() else [path]
        if not inside:
            raise InputError(f"{path} has no R2R_<split>.json; name the --out of nvsim export tasks.")
        found += [file for file in inside if file not in found]
    parents = {file.parent for file in found}
    if len(parents) != 1:
        raise InputError(
            "The tasks files are in several folders; name the files of one folder, which also stores their review."
        )
    entries = tuple(TaskEntry(file.stem, task) for file in found for task in read_tasks(file))
    review_file = parents.pop() / FOLDER / FILE
    return TaskFolder(review_file, entries, read_review(review_file))


def counts_of(folder: TaskFolder) -> list[dict[str, str | int]]:
    """Returns for each split the numbers of tasks, and of accepted, rejected, unread and rewritten ones."""
    rows: dict[str, dict[str, str | int]] = {}
    for entry in folder.entries:
        row = rows.setdefault(
            entry.split, {"split": entry.split, **dict.fromkeys(("tasks", *STATES[1:], "unread", "rewritten"), 0)}
        )
        verdict = folder.review[entry.key]
        for name in ("tasks", verdict.state or "unread", *(["rewritten"] if verdict.instructions is not None else [])):
            row[name] = int(row[name]) + 1
    return list(rows.values())


def export_reviewed(
    entries: Iterable[TaskEntry], review: Review, out: Path, unread: bool = False, overwrite: bool = False
) -> list[Path]:
    """Writes the accepted tasks with their rewritten instructions as `<split>.json` into `out`; returns the paths.

    With `unread`, tasks without a verdict are written too. With `overwrite`, files with these names are replaced. This
    is for the folder of the review itself. Raises InputError if there are no tasks to write, or if `out` already has
    files with these names.
    """
    states = ("accepted", "") if unread else ("accepted",)
    chosen: dict[str, list[Task]] = {}
    for entry in entries:
        if review[entry.key].state in states:
            chosen.setdefault(entry.split, []).append(review.reviewed(entry.key, entry.task))
    if not chosen:
        why = "Every task is rejected" if unread else "No task is accepted"
        raise InputError(f"{why}; accept tasks before you export them.")
    files = {out / f"{split}.json": tasks for split, tasks in chosen.items()}
    if not overwrite and any(os.path.lexists(path) for path in files):
        raise InputError(f"{out} already has these tasks files; choose another folder.")
    atomic.make_folder(out)
    return [write_tasks(path, tasks) for path, tasks in files.items()]


def task_error(task: Task, distances: Distances) -> str:
    """Returns the reason why `task` does not fit the graph, or "". A joined path need not be a shortest path."""
    wrong = distances.find_invalid_step(task.path)
    if wrong or isinstance(task, JoinedTask) or len(task.path) < 2:
        return wrong
    rows = [distances.row[id] for id in task.path]
    meters = float(distances.meters[rows[:-1], rows[1:]].sum())
    longer = meters - float(distances.meters[rows[0], rows[-1]])
    return f"a path {longer:.2f} m shorter leads to the goal" if longer > SAME_LENGTH else ""


@dataclass(frozen=True)
class Episode:
    """A trajectory and its scores as in `nvsim evaluate r2r`: ne in meters, success, spl from 0 to 1."""

    poses: tuple[Pose, ...]
    ne: float
    success: bool
    spl: float


def scored_episodes(tasks: Iterable[Task], trajectories: Trajectories, distances: Distances) -> Mapping[str, Episode]:
    """Returns instr_id -> episode, for tasks and trajectories that fit the graph of `distances`."""
    ids: list[str] = []
    alone: list[Task] = []  # tasks with one instruction each and new path_ids
    walks: dict[str, tuple[Pose, ...]] = {}
    for task in tasks:
        if len(task.path) < 2 or distances.find_invalid_step(task.path):
            continue
        for id in task.instr_ids:
            poses = tuple(trajectories.get(id, ()))
            if poses and not distances.find_invalid_step([pose[0] for pose in poses]):
                alone.append(Task(len(ids), "", task.path, task.heading))
                walks[alone[-1].instr_ids[0]] = poses
                ids.append(id)
    if not ids:
        return {}
    scores = score(alone, walks, {"": distances})
    figures = zip(walks.values(), scores.ne.tolist(), scores.success.tolist(), scores.spl.tolist())
    return {id: Episode(poses, ne, bool(success), spl) for id, (poses, ne, success, spl) in zip(ids, figures)}
