"""Reads the results of the stages as project versions 1 to 3 stored them: as JSON in the table `meta`."""

from __future__ import annotations

import json
import sqlite3
from dataclasses import replace
from pathlib import Path
from typing import Any

from nvsim.files import tables
from nvsim.files.tables import COUNT, NUMBER, TEXT
from nvsim.project.state.results import Part, Result, Slot, StageResults, Unfinished, trusted
from nvsim.project.work import STAGES

_ROW = {"stage": TEXT, "part": COUNT, "key": TEXT, "seconds": NUMBER, "finished": NUMBER.or_null, "summary": TEXT}
_STAGE_OF = {"imported": "import", "depth": "depth", "masks": "floors", "floor": "floors"}


def read_version_3(c: sqlite3.Connection, path: Path) -> StageResults:
    """The results in the database at `path`. Skips damaged values of the table `meta`. Raises InputError if the table
    `stages` is damaged."""
    meta: dict[str, str] = dict(tables.read(c, path, "meta", {"key": TEXT, "value": TEXT}))
    found: dict[str, dict[int, Part]] = {}
    for stage, part, key, seconds, finished, summary in tables.read(c, path, "stages", _ROW, "WHERE state = 'done'"):
        found.setdefault(stage, {})[part] = Part(key, seconds, finished or 0.0, summary)
    if "import" in found and 0 in found["import"]:
        found["import"][0] = replace(found["import"][0], settings=meta.get("capture_config", ""))
    batch = _object(meta.get("batch train"))
    for part, row in found.get("train", {}).items():
        if part in _list(batch.get("submaps")):
            found["train"][part] = replace(row, batch=str(batch.get("batch", "")))
    files: dict[str, dict[str, str]] = {}
    for name, place in trusted(_object(meta.get("places"))).items():
        stage = name.removeprefix("cut/") if name.startswith("cut/") else _STAGE_OF.get(name, "train")
        files.setdefault(stage, {})[name] = place
    results: dict[tuple[Slot, str], Result] = {
        ("in use", stage): Result(found.get(stage, {}), files.get(stage, {})) for stage in found.keys() | files.keys()
    }
    slots: tuple[Slot, ...] = ("previous", "next")
    for slot in slots:
        for stage in STAGES:
            result = _result(_object(meta.get(f"{slot} {stage}")))
            if result is not None:
                results[slot, stage] = result
    unfinished = {}
    # Versions below 3 stored unfinished work in the row of the result.
    for stage, part, key in tables.read(
        c, path, "stages", {"stage": TEXT, "part": COUNT, "key": TEXT}, "WHERE state != 'done'"
    ):
        unfinished[stage, part] = Unfinished(key)
    for name, text in meta.items():
        kind, _, rest = name.partition(" ")
        stage, _, number = rest.partition(" ")
        work = _object(text) if kind == "work" and number.isdecimal() else {}
        if isinstance(work.get("key"), str) and isinstance(work.get("number"), int):
            unfinished[stage, int(number)] = Unfinished(work["key"], work["number"])
    generation = meta.get("generation", "0")
    return StageResults(results, unfinished, int(generation) if generation.isdecimal() else 0)


def _result(data: dict[str, Any]) -> Result | None:
    """A result that is not in use, None if it is damaged."""
    try:
        parts = {
            int(number): Part(
                _text(row["key"]), float(row["seconds"]), float(row["finished"]), json.dumps(_dict(row["summary"]))
            )
            for number, row in data["rows"].items()
        }
        values = {name: _text(text) for name, text in data["values"].items()}
        files = {**_dict(data["places"]), **({"graph": values["graph"]} if "graph" in values else {})}
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    if 0 in parts:
        parts[0] = replace(parts[0], settings=values.get("capture_config", ""))
    return Result(parts, trusted(files))


def _object(text: str | None) -> dict[str, Any]:
    try:
        found = json.loads(text or "{}")
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _list(found: object) -> list[Any]:
    return found if isinstance(found, list) else []


def _text(found: object) -> str:
    if not isinstance(found, str):
        raise TypeError
    return found


def _dict(found: object) -> dict[str, Any]:
    if not isinstance(found, dict):
        raise TypeError
    return found
