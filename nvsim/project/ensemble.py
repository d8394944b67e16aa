"""The models in use, and how newly trained models replace them.

If the models in use belong to the newest cut into submaps, each new model replaces one of them. If they belong to a
previous cut, new models are used only when all submaps of the newest cut are trained.
"""

from __future__ import annotations

import json
import sqlite3
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from nvsim.files.atomic import remove
from nvsim.project import results
from nvsim.project.project import Project
from nvsim.project.results import Result, Row, remove_folder
from nvsim.project.work import StageName

STAGE: StageName = "train"
_BATCH = "batch train"


def trained_key(project: Project, submap: int) -> str:
    """The key of the finished model of a submap in the newest cut, "" if there is none. The model may not be in use
    yet, because other submaps are still missing."""
    row = _rows(project).get(submap)
    return "" if row is None else row.key


def waiting(project: Project) -> tuple[int, ...]:
    """Submaps of the newest cut that are trained while the models of a previous cut are in use."""
    return tuple(sorted(_rows(project))) if results.is_former(project.connection, STAGE) else ()


def _rows(project: Project) -> dict[int, Row]:
    c = project.connection
    if not results.is_former(c, STAGE):
        return results.rows_of(c, STAGE)
    return _next(c).rows


def _next(c: sqlite3.Connection) -> Result:
    """Finished models of the newest cut that are not in use yet."""
    found = results.kept(c, STAGE, "next")
    newest = results.places(c).get("cut/submaps")
    if found is None or found.places.get("cut/train") != newest:
        return Result(places={} if newest is None else {"cut/train": newest})
    return found


def add_model(project: Project, submap: int, seconds: float, figures: dict[str, Any], batch: str) -> bool:
    """Commits a finished model from the place where it was made. Returns whether it is in use.

    A `batch` is all models that are trained with one configuration. The models in use before the first model of a batch
    are kept as the last result.
    """
    c = project.connection
    with project.transaction():
        place = results.made_at(c, STAGE, submap)
        found = results.work(c, STAGE, submap)
        row = Row(found[0] if found else "", seconds, time.time(), figures)
        results.drop_work(c, STAGE, submap)
        former = results.is_former(c, STAGE)
        if former:
            new = _next(c)
            new = Result({**new.rows, submap: row}, {**new.places, **place})
            used = set(new.rows) >= {s.index for s in project.submaps()}
            if used:
                results.keep(c, STAGE, results.in_use(c, project.root, STAGE))
                results.put_to_use(c, STAGE, new)
                results.put(c, _BATCH, None)
            results.keep(c, STAGE, None if used else new, "next")
        else:
            _keep_before(c, project.root, batch, submap)
            places = {**results.places(c), **place}
            if "cut/submaps" in places:
                places["cut/train"] = places["cut/submaps"]
            results.put_places(c, places)
            results.put_row(c, STAGE, submap, row)
            results.keep(c, STAGE, None, "next")
            used = True
    remove_folder(project.layout.live(submap))
    project.layout.checkpoint(submap).unlink(missing_ok=True)
    results.tidy(c, project.root)
    return used


def _keep_before(c: sqlite3.Connection, root: Path, batch: str, submap: int) -> None:
    try:
        known = json.loads(results.value(c, _BATCH) or "{}")
        same = known["batch"] == batch and submap not in known["submaps"]
        done = list(known["submaps"]) if same else []
    except (ValueError, KeyError, TypeError):
        same, done = False, []
    if not same:
        before = results.in_use(c, root, STAGE)
        if before is not None:
            results.keep(c, STAGE, before)
    results.put(c, _BATCH, json.dumps({"batch": batch, "submaps": [*done, submap]}))


def forget_batch(c: sqlite3.Connection) -> None:
    """Starts a new batch, so that the models in use are kept when the next model is finished. Call it inside a
    transaction."""
    results.put(c, _BATCH, None)


def clear_unfinished(project: Project, of_others: Iterable[int]) -> None:
    """Removes checkpoints, partly trained models, and partly written files of killed processes. Keeps those of the
    submaps `of_others` whose training can be continued."""
    c, layout = project.connection, project.layout
    left = {part for stage, part in results.works(c) if stage == STAGE}
    wanted = left & set(of_others)
    with project.transaction():
        for part in left - wanted:
            results.drop_work(c, STAGE, part)
    keep = {p for part in wanted for p in (layout.checkpoint(part), layout.live(part))}
    for path in [*layout.checkpoints.glob("submap_*.ckpt"), *layout.checkpoints.glob("live_*")]:
        if path in keep:
            continue
        if path.is_dir():
            remove_folder(path)
        else:
            path.unlink(missing_ok=True)
    for path in layout.checkpoints.glob(".*"):
        remove(path)
    results.tidy(c, project.root)
