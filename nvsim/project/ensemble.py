"""The models in use, and how newly trained models replace them.

If the models in use belong to the newest cut into submaps, each new model replaces one of them. If they belong to a
previous cut, new models are used only when all submaps of the newest cut are trained.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from nvsim.files.atomic import remove
from nvsim.project.ledger import made
from nvsim.project.project import Project
from nvsim.project.state import results
from nvsim.project.state.results import Part, Result, StageResults, remove_folder
from nvsim.project.work import StageName

STAGE: StageName = "train"


def trained_key(project: Project, submap: int) -> str:
    """The key of the finished model of a submap in the newest cut, "" if there is none. The model may not be in use
    yet, because other submaps are still missing."""
    part = _newest(project.stage_results()).parts.get(submap)
    return "" if part is None else part.key


def waiting(project: Project) -> tuple[int, ...]:
    """Submaps of the newest cut that are trained while the models of a previous cut are in use."""
    found = project.stage_results()
    return tuple(sorted(_newest(found).parts)) if STAGE in found.former else ()


def _newest(found: StageResults) -> Result:
    """The finished models of the newest cut, which may not be in use yet."""
    if STAGE not in found.former:
        return found.get("in use", STAGE) or Result()
    waiting, newest = found.get("next", STAGE), found.places["cut/submaps"]
    if waiting is None or waiting.files.get("cut/train") != newest:
        return Result(files={"cut/train": newest})
    return waiting


def add_model(project: Project, submap: int, seconds: float, figures: dict[str, Any], batch: str) -> bool:
    """Commits a finished model from the place where it was made. Returns whether it is in use.

    A `batch` is all models that are trained with one configuration. The models in use before the first model of a batch
    are kept as the last result.
    """
    found, root = project.stage_results(), project.root
    work = found.unfinished.get((STAGE, submap))
    part = made(figures, "" if work is None else work.key, seconds)
    files = found.made_at(STAGE, submap)
    found = found.dropped(STAGE, submap)
    used = True
    if STAGE in found.former:
        new = _newest(found)
        new = Result({**new.parts, submap: part}, {**new.files, **files})
        used = set(new.parts) >= {s.index for s in project.submaps()}
        if used:
            found = found.put("previous", STAGE, found.in_use(STAGE, root)).put_to_use(STAGE, new)
        found = found.put("next", STAGE, None if used else new)
    else:
        parts = (found.get("in use", STAGE) or Result()).parts
        before = None
        if all(p.batch != batch for p in parts.values()) or (submap in parts and parts[submap].batch == batch):
            before = found.in_use(STAGE, root)
            found = without_batch(found)
        if "cut/submaps" in found.places:
            files["cut/train"] = found.places["cut/submaps"]
        found = found.finished(STAGE, {submap: replace(part, batch=batch)}, files, before).put("next", STAGE, None)
    project.set_stage_results(found)
    remove_folder(project.layout.live(submap))
    project.layout.checkpoint(submap).unlink(missing_ok=True)
    results.tidy(found, root)
    return used


def without_batch(found: StageResults) -> StageResults:
    """Starts a new batch, so that the models in use are kept when the next model is finished."""
    in_use = found.get("in use", STAGE) or Result()
    parts: dict[int, Part] = {index: replace(part, batch="") for index, part in in_use.parts.items()}
    return found.put("in use", STAGE, Result(parts, in_use.files))


def clear_unfinished(project: Project, of_others: Iterable[int]) -> None:
    """Removes checkpoints, partly trained models, and partly written files of killed processes. Keeps those of the
    submaps `of_others` whose training can be continued."""
    found, layout = project.stage_results(), project.layout
    left = {part for stage, part in found.unfinished if stage == STAGE}
    wanted = left & set(of_others)
    project.set_stage_results(found := found.dropped(STAGE, *(left - wanted)))
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
    results.tidy(found, project.root)
