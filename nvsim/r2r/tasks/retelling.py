"""Replaces the instructions of a dataset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from nvsim.r2r.tasks.joining import joined_instructions
from nvsim.r2r.tasks.splitting import Dataset
from nvsim.r2r.tasks.task import JoinedTask, Task


def replace_instructions(dataset: Dataset, texts: Mapping[int, Sequence[str]]) -> Dataset:
    """Gives every task the instructions of its path_id, if there are any; joined paths get those of their two parts."""
    updated: dict[int, Task] = {}
    for task in (task for tasks in dataset.splits.values() for task in tasks):
        updated[task.path_id] = replace(task, instructions=tuple(texts.get(task.path_id, task.instructions)))
    splits = {name: [updated[task.path_id] for task in tasks] for name, tasks in dataset.splits.items()}
    joined = {name: [_joined(task, updated) for task in tasks] for name, tasks in dataset.joined.items()}
    return replace(dataset, splits=splits, joined=joined)


def _joined(task: JoinedTask, updated: Mapping[int, Task]) -> JoinedTask:
    instructions = joined_instructions(updated[task.first_path_id], updated[task.second_path_id])
    return replace(task, instructions=instructions)
