"""Records the stages that are done, and for which inputs. The key of a stage is a hash of everything that it depends
on. A stage is current if the key of its result equals the key of the present inputs."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sqlite3
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from nvsim.project import results
from nvsim.project.project import Project
from nvsim.project.stage_records import StageRecord, record

__all__ = ["StageRecord", "begin", "finish", "forget", "is_current", "key_of", "record"]


def key_of(*parts: object) -> str:
    """A hash of configuration dataclasses, other keys and plain values."""

    def plain(part: object) -> object:
        if dataclasses.is_dataclass(part) and not isinstance(part, type):
            return {type(part).__name__: dataclasses.asdict(part)}
        return part

    text = json.dumps([plain(p) for p in parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def is_current(project: Project, stage: str, key: str, part: int = 0) -> bool:
    """Whether the result in use of a part of a stage has this key."""
    found = record(project, stage, part)
    return found is not None and found.key == key


def begin(project: Project, stage: str, key: str, part: int = 0) -> bool:
    """Records that a part is being made; the result in use remains in use. Returns whether unfinished work for these
    inputs can be continued."""
    c = project.connection
    found = results.work(c, stage, part)
    if found is not None and found[0] == key:
        return True
    # Project versions below 3 stored unfinished work in the same row.
    before = c.execute(
        "SELECT key FROM stages WHERE stage = ? AND part = ? AND state != 'done'", (stage, part)
    ).fetchone()
    with project.transaction():
        results.begin_work(c, project.root, stage, part, key)
        c.execute("DELETE FROM stages WHERE stage = ? AND part = ? AND state != 'done'", (stage, part))
    results.tidy(c, project.root)
    return before is not None and before[0] == key


def finish(
    project: Project,
    stage: str,
    seconds: float,
    summary: dict[str, Any],
    part: int = 0,
    *,
    write: Callable[[sqlite3.Connection], None] | None = None,
    values: Mapping[str, str] | None = None,
    also: Mapping[int, str] | None = None,
) -> None:
    """Commits the part that was made since `begin`, and replaces the result in use.

    The commit is one transaction with the statements of `write` and the keys of other parts in `also`. The previous
    result is kept, together with `values`, as the last result of the stage.
    """
    c = project.connection
    found = results.work(c, stage, part)
    # A part without `begin`, as in a project of an older version, keeps its present key.
    key = found[0] if found is not None else getattr(record(project, stage, part), "key", "")
    now = time.time()
    with project.transaction():
        before = results.in_use(c, project.root, stage) if part == 0 else None
        if before is not None:
            results.keep(c, stage, replace(before, values={**before.values, **(values or {})}))
        if part == 0:
            made = results.made_at(c, stage)
            own = results.places(c) | {name: place for name, place in made.items() if (project.root / place).exists()}
            newest = own.get("cut/submaps")
            if stage == "floors" and newest is not None:
                own["cut/floors"] = newest
            results.put_places(c, own)
        results.put_row(c, stage, part, results.Row(key, seconds, now, summary))
        for other, its_key in (also or {}).items():
            results.put_row(c, stage, other, results.Row(its_key, 0.0, now, {}))
        results.drop_work(c, stage, part)
        if write is not None:
            write(c)
    results.tidy(c, project.root)


def forget(project: Project, stage: str) -> None:
    """Removes the records of a stage, as if it had never run."""
    with project.transaction() as c:
        c.execute("DELETE FROM stages WHERE stage = ?", (stage,))
        c.execute("DELETE FROM meta WHERE key LIKE ?", (f"work {stage} %",))
