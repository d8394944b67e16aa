"""A file with the verdicts about tasks and with rewritten instructions, separate from the generated tasks.

Format: {"format": 1, "tasks": [{split, path_id, scan, state, instructions}]}. The state is "accepted", "rejected" or
"". The instructions are null if those of the task are unchanged.
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
        self._put(key, replace(self[key], state=state))

    def set_instructions(self, key: Key, instructions: Iterable[str] | None) -> None:
        self._put(key, replace(self[key], instructions=None if instructions is None else tuple(instructions)))

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

    def _put(self, key: Key, verdict: Verdict) -> None:
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
        raise InputError(f"{where} is {shown(item)}; it must be an object with split, path_id, scan and state.")
    split, id, scan = item.get("split"), item.get("path_id"), item.get("scan")
    state, texts = item.get("state"), item.get("instructions")
    named = isinstance(split, str) and isinstance(id, int) and isinstance(scan, str)
    valid_texts = texts is None or (isinstance(texts, list) and all(isinstance(text, str) for text in texts))
    if not named or state not in STATES or not valid_texts:
        raise InputError(f"{where} is invalid ({shown(item)}); correct it, or move the file away.")
    return (str(split), int(id), str(scan)), Verdict(str(state), None if texts is None else tuple(texts))  # type: ignore[arg-type]
