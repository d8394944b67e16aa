"""Reads the database record of a finished part of a stage."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from nvsim.errors import InputError
from nvsim.files.reading import reading
from nvsim.files.tables import NUMBER, TEXT

if TYPE_CHECKING:
    from nvsim.project.project import Project

_STAGE = {"key": TEXT, "seconds": NUMBER, "summary": TEXT}


@dataclass(frozen=True)
class StageRecord:
    """The finished result in use: key of its inputs, seconds of work, and figures of the summary."""

    key: str
    seconds: float
    summary: dict[str, Any]


def record(project: Project, stage: str, part: int = 0) -> StageRecord | None:
    """The record of a part of a stage in use, even while the part is being made again; None if it was never finished.
    Raises InputError if the record is damaged."""
    rows = project.read("stages", _STAGE, "WHERE stage = ? AND part = ? AND state = 'done'", (stage, part))
    if not rows:
        return None
    key, seconds, text = rows[0]
    with reading(project.layout.database, f"a database with a summary of the stage {stage}", "run the stage again"):
        summary = json.loads(text)
    if not isinstance(summary, dict):
        raise InputError(f"{project.layout.database}: the stage {stage} has no summary; run it again.")
    return StageRecord(key, seconds, summary)
