"""Records the stages that are done, and for which inputs. The key of a stage is a hash of everything that it depends
on. A stage is current if the key of its result equals the key of the present inputs."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sqlite3
import time
from collections.abc import Callable, Mapping
from typing import Any

from nvsim import __version__
from nvsim.project.project import Project
from nvsim.project.state import results
from nvsim.project.state.results import Part, Result


def key_of(*parts: object) -> str:
    """A hash of configuration dataclasses, other keys and plain values."""

    def plain(part: object) -> object:
        if dataclasses.is_dataclass(part) and not isinstance(part, type):
            return {type(part).__name__: dataclasses.asdict(part)}
        return part

    text = json.dumps([plain(p) for p in parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def record(project: Project, stage: str, part: int = 0) -> Part | None:
    """A part of a stage in use, even while it is being made again; None if it was never finished. Raises InputError if
    it is damaged."""
    found = project.stage_results().part(stage, part)
    if found is not None:
        _ = found.summary
    return found


def is_current(project: Project, stage: str, key: str, part: int = 0) -> bool:
    """Whether the result in use of a part of a stage has this key."""
    found = record(project, stage, part)
    return found is not None and found.key == key


def begin(project: Project, stage: str, key: str, part: int = 0) -> bool:
    """Records that a part is being made; the result in use remains in use. Returns whether unfinished work for these
    inputs can be continued."""
    found = project.stage_results()
    work = found.unfinished.get((stage, part))
    if work is not None and work.key == key:
        return True
    project.set_stage_results(found := found.begun(stage, part, key, project.root))
    results.tidy(found, project.root)
    return False


def made(summary: Mapping[str, Any], key: str, seconds: float, settings: str = "", batch: str = "") -> Part:
    """A part of a stage that finished just now."""
    return Part(key, seconds, time.time(), json.dumps(summary), __version__, settings, batch)


def finish(
    project: Project,
    stage: str,
    seconds: float,
    summary: Mapping[str, Any],
    part: int = 0,
    *,
    write_rows: Callable[[sqlite3.Connection], None] | None = None,
    files: Mapping[str, str] | None = None,
    settings: str = "",
    before: Mapping[str, str] | None = None,
    also: Mapping[int, str] | None = None,
    keep: bool = True,
) -> None:
    """Commits the part that was made since `begin`, and replaces the result in use.

    write_rows  writes other tables in the same transaction
    files       places of files that are not made at the places of `begin`
    settings    options as JSON, if later stages read them
    before      files of the replaced result, in addition to those in use
    also        keys of other parts that are made together with this one
    keep        whether the replaced result becomes the previous result of the stage
    """
    found, root = project.stage_results(), project.root
    # A part without `begin`, as in a project of an older version, keeps its present key.
    start = found.unfinished.get((stage, part)) or found.part(stage, part)
    parts = {part: made(summary, "" if start is None else start.key, seconds, settings)}
    parts |= {other: made({}, key, 0.0) for other, key in (also or {}).items()}
    new = {name: place for name, place in found.made_at(stage, part).items() if part == 0 and (root / place).exists()}
    newest = found.places.get("cut/submaps")
    if stage == "floors" and part == 0 and newest is not None:
        new["cut/floors"] = newest
    replaced = found.in_use(stage, root) if part == 0 and keep else None
    if replaced is not None:
        replaced = Result(replaced.parts, {**replaced.files, **(before or {})})
    found = found.finished(stage, parts, new | dict(files or {}), replaced)
    with project.transaction() as c:
        results.write(c, found)
        if write_rows is not None:
            write_rows(c)
    results.tidy(found, root)


def forget(project: Project, stage: str) -> None:
    """Removes the records of a stage, as if it had never run."""
    found = project.stage_results()
    in_use = found.get("in use", stage) or Result()
    unfinished = {key: work for key, work in found.unfinished.items() if key[0] != stage}
    found = dataclasses.replace(found, unfinished=unfinished).put("in use", stage, Result({}, in_use.files))
    project.set_stage_results(found)
