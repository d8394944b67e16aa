"""Decisions about tasks and the instructions that people wrote, in a file of its own beside the generated ones.

Format: {"format": 1, "tasks": [{split, path_id, scan, state, instructions}]}, state "accepted", "rejected" or "", and
instructions null where those of the task stand.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from nvsim.errors import InputError, shown
from nvsim.files import atomic
from nvsim.files.regular import read_json
from nvsim.r2r.tasks.task import Task

FOLDER = "reviewed"
FILE = "tasks_review.json"
FORMAT = 1
STATES = ("", "accepted", "rejected")

Key = tuple[str, int, str]
"""Split, path_id and scan."""


@dataclass(frozen=True)
class Verdict:
    """state         one of STATES
    instructions  what people wrote instead of the generated ones; None where nobody did
    """

    state: str = ""
    instructions: tuple[str, ...] | None = None


class Review:
    """The verdicts about a folder of tasks, each change undone by `undo`."""

    def __init__(self, verdicts: Mapping[Key, Verdict] | None = None) -> None:
        self._verdicts = dict(verdicts or {})
        self._before: list[tuple[Key, Verdict]] = []

    def __getitem__(self, key: Key) -> Verdict:
        return self._verdicts.get(key, Verdict())

    def set_state(self, key: Key, state: str) -> None:
        """Raises ValueError where `state` is none of STATES."""
        if state not in STATES:
            raise ValueError(f"{state!r} is none of {STATES}")
        self._put(key, replace(self[key], state=state))

    def set_instructions(self, key: Key, instructions: Iterable[str] | None) -> None:
        self._put(key, replace(self[key], instructions=None if instructions is None else tuple(instructions)))

    def undo(self) -> Key | None:
        """Takes the last change of this session back; returns what it was about, None where there was none."""
        if not self._before:
            return None
        key, verdict = self._before.pop()
        self._verdicts[key] = verdict
        return key

    def reviewed(self, key: Key, task: Task) -> Task:
        """The task with the instructions that people wrote, if they did."""
        written = self[key].instructions
        return task if written is None else replace(task, instructions=written)

    def write(self, path: Path) -> None:
        """Raises InputError when the disk refuses."""
        rows = [
            {"split": split, "path_id": id, "scan": scan, "state": v.state, "instructions": v.instructions}
            for (split, id, scan), v in sorted(self._verdicts.items())
            if v != Verdict()
        ]
        atomic.make_folder(path.parent)
        atomic.write_text(path, json.dumps({"format": FORMAT, "tasks": rows}, indent=1) + "\n")

    def _put(self, key: Key, verdict: Verdict) -> None:
        if verdict != self[key]:
            self._before.append((key, self[key]))
            self._verdicts[key] = verdict


def read_review(path: Path) -> Review:
    """An empty review where there is no file. Raises InputError with the item where it cannot be read."""
    if not path.exists():
        return Review()
    found = read_json(path, "a review of tasks", "move it away to begin a new one")
    items = found.get("tasks") if isinstance(found, dict) and found.get("format") == FORMAT else None
    if not isinstance(items, list):
        raise InputError(f"{path} is no review of tasks of format {FORMAT}; move it away to begin a new one.")
    return Review(dict(_row(item, f"{path}, item {i}") for i, item in enumerate(items)))


def _row(item: Any, where: str) -> tuple[Key, Verdict]:
    if not isinstance(item, dict):
        raise InputError(f"{where} is {shown(item)}; it must be an object with split, path_id, scan and state.")
    split, id, scan = item.get("split"), item.get("path_id"), item.get("scan")
    state, texts = item.get("state"), item.get("instructions")
    named = isinstance(split, str) and isinstance(id, int) and isinstance(scan, str)
    told = texts is None or (isinstance(texts, list) and all(isinstance(text, str) for text in texts))
    if not named or state not in STATES or not told:
        raise InputError(f"{where} makes no sense ({shown(item)}); correct it, or move the file away.")
    return (str(split), int(id), str(scan)), Verdict(str(state), None if texts is None else tuple(texts))  # type: ignore[arg-type]
