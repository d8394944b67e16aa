"""Which stage is done for which inputs. A stage's key is a hash of everything that it depends on; a stage is current
while the key it was finished with is the key it would be run with now."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import time
from dataclasses import dataclass
from typing import Any

from nvsim.errors import InputError
from nvsim.project.project import Project
from nvsim.reading import reading
from nvsim.tables import NUMBER, TEXT


@dataclass(frozen=True)
class StageRecord:
    """key of the inputs, state "running" or "done", seconds of work so far, summary figures."""

    key: str
    state: str
    seconds: float
    summary: dict[str, Any]


def key_of(*parts: object) -> str:
    """A hash of configuration dataclasses, other keys and plain values."""

    def plain(part: object) -> object:
        if dataclasses.is_dataclass(part) and not isinstance(part, type):
            return {type(part).__name__: dataclasses.asdict(part)}
        return part

    text = json.dumps([plain(p) for p in parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


_STAGE = {"key": TEXT, "state": TEXT, "seconds": NUMBER, "summary": TEXT}


def record(project: Project, stage: str, part: int = 0) -> StageRecord | None:
    rows = project.read("stages", _STAGE, "WHERE stage = ? AND part = ?", (stage, part))
    if not rows:
        return None
    key, state, seconds, text = rows[0]
    with reading(project.layout.database, f"a database with a summary of the stage {stage}", "run the stage again"):
        summary = json.loads(text)
    if not isinstance(summary, dict):
        raise InputError(f"{project.layout.database}: the stage {stage} has no summary; run it again.")
    return StageRecord(key, state, seconds, summary)


def is_current(project: Project, stage: str, key: str, part: int = 0) -> bool:
    found = record(project, stage, part)
    return found is not None and found.state == "done" and found.key == key


def begin(project: Project, stage: str, key: str, part: int = 0) -> bool:
    """Marks the stage as running. Returns whether unfinished work for the same inputs may be continued."""
    found = record(project, stage, part)
    resumed = found is not None and found.key == key
    with project.transaction() as c:
        if not resumed:
            c.execute(
                "INSERT OR REPLACE INTO stages (stage, part, key, state) VALUES (?, ?, ?, 'running')",
                (stage, part, key),
            )
        else:
            c.execute("UPDATE stages SET state = 'running' WHERE stage = ? AND part = ?", (stage, part))
    return resumed


def finish(project: Project, stage: str, seconds: float, summary: dict[str, Any], part: int = 0) -> None:
    with project.transaction() as c:
        c.execute(
            "UPDATE stages SET state = 'done', seconds = ?, finished = ?, summary = ? WHERE stage = ? AND part = ?",
            (seconds, time.time(), json.dumps(summary), stage, part),
        )


def forget(project: Project, stage: str) -> None:
    """The stage was never run."""
    with project.transaction() as c:
        c.execute("DELETE FROM stages WHERE stage = ?", (stage,))
