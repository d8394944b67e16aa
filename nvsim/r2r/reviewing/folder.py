"""A folder of tasks as it is reviewed, and the files of what was accepted."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.r2r.reviewing.review import FILE, FOLDER, Key, Review, read_review
from nvsim.r2r.tasks.task import Task
from nvsim.r2r.tasks.task_files import read_tasks, write_tasks


@dataclass(frozen=True)
class Entry:
    """split   R2R_train and so on, the name of the file"""

    split: str
    task: Task

    @property
    def key(self) -> Key:
        return self.split, self.task.path_id, self.task.scan


@dataclass(frozen=True)
class Folder:
    """A place with files of tasks: `review_file` is where verdicts about them are kept."""

    review_file: Path
    entries: tuple[Entry, ...]
    review: Review


def read_folder(path: Path) -> Folder:
    """A file of tasks, or a folder with R2R_*.json and R4R_*.json. Raises InputError where none is there or one cannot
    be read."""
    files = sorted([*path.glob("R2R_*.json"), *path.glob("R4R_*.json")]) if path.is_dir() else [path]
    if not files:
        raise InputError(f"{path} holds no R2R_<split>.json; name the --out of nvsim export tasks.")
    entries = tuple(Entry(file.stem, task) for file in files for task in read_tasks(file))
    review_file = (path if path.is_dir() else path.parent) / FOLDER / FILE
    return Folder(review_file, entries, read_review(review_file))


def export_reviewed(entries: Iterable[Entry], review: Review, out: Path) -> list[Path]:
    """Writes the accepted tasks, as people edited them, as `<split>.json` into `out`; returns the paths. Raises
    InputError where none is accepted, or `out` holds the tasks themselves under these names."""
    chosen: dict[str, list[Task]] = {}
    for entry in entries:
        if review[entry.key].state == "accepted":
            chosen.setdefault(entry.split, []).append(review.reviewed(entry.key, entry.task))
    if not chosen:
        raise InputError("No task is accepted; accept tasks before they are written.")
    files = {out / f"{split}.json": tasks for split, tasks in chosen.items()}
    if out.name != FOLDER and any(os.path.lexists(path) for path in files):
        raise InputError(f"{out} holds files of tasks already; choose another folder.")
    atomic.make_folder(out)
    return [write_tasks(path, tasks) for path, tasks in files.items()]
