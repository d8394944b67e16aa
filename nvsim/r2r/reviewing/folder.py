"""Reads a folder of tasks with its review, and writes the accepted tasks."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.r2r.reviewing.review import FILE, FOLDER, STATES, Key, Review, read_review
from nvsim.r2r.tasks.task import Task
from nvsim.r2r.tasks.task_files import read_tasks, write_tasks


@dataclass(frozen=True)
class Entry:
    """A task and the name of its file without .json: `split` is R2R_train and so on."""

    split: str
    task: Task

    @property
    def key(self) -> Key:
        return self.split, self.task.path_id, self.task.scan


@dataclass(frozen=True)
class Folder:
    """The tasks of a folder. `review_file` stores the verdicts about them."""

    review_file: Path
    entries: tuple[Entry, ...]
    review: Review


def read_folder(*paths: Path) -> Folder:
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
    entries = tuple(Entry(file.stem, task) for file in found for task in read_tasks(file))
    review_file = parents.pop() / FOLDER / FILE
    return Folder(review_file, entries, read_review(review_file))


def counts_of(folder: Folder) -> list[dict[str, str | int]]:
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
    entries: Iterable[Entry], review: Review, out: Path, unread: bool = False, overwrite: bool = False
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
