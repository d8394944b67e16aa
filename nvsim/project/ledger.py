"""Records the stages that are done, and for which inputs. The key of a stage is a hash of everything that it depends
on. A stage is current if the key of its result equals the key of the present inputs."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import sqlite3
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

from nvsim import __version__
from nvsim.files.atomic import remove
from nvsim.project.project import Project
from nvsim.project.state import results
from nvsim.project.state.results import (
    CONTENT,
    StagePart,
    StageResult,
    StageResults,
    model_folders,
    remove_folder,
)
from nvsim.project.work import StageName

TRAIN: StageName = "train"


def key_of(*parts: object) -> str:
    """A hash of configuration dataclasses, other keys and plain values."""

    def plain(part: object) -> object:
        if dataclasses.is_dataclass(part) and not isinstance(part, type):
            return {type(part).__name__: dataclasses.asdict(part)}
        return part

    text = json.dumps([plain(p) for p in parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def record(project: Project, stage: str, part: int = 0) -> StagePart | None:
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


def removal_key(project: Project) -> list[str]:
    """The part of a stage's key that identifies the removed Gaussians; empty if none are removed."""
    from nvsim.splats.files import removal_digest

    digests = [removal_digest(folder) for folder in model_folders(project.layout).values()]
    return digests if any(digests) else []


def content_key(project: Project) -> str:
    """Identifies the content that all stages after the import are computed from: the capture in use, without the
    Gaussians that the user removed. "" if nothing is imported. Raises InputError if files are damaged."""
    imported, capture = project.stage_results().part("import"), project.capture()
    if imported is None or capture is None:
        return ""
    removed = [] if capture.has_images else removal_key(project)
    return key_of(imported.key, *removed) if removed else imported.key


def begin_part(project: Project, stage: str, key: str, part: int = 0) -> bool:
    """Records that a part is being made; the result in use remains in use. Returns whether unfinished work for these
    inputs can be continued."""
    found = project.stage_results()
    work = found.unfinished.get((stage, part))
    if work is not None and work.key == key:
        return True
    project.set_stage_results(found := found.with_unfinished_part(stage, part, key, project.root))
    results.remove_unreferenced_files(found, project.root)
    return False


def _finished_part(
    project: Project, stage: str, summary: Mapping[str, Any], key: str, seconds: float, settings: str = ""
) -> StagePart:
    """A part of a stage that finished just now, from the present content."""
    content = "" if stage == "import" else content_key(project)
    if content:
        summary = {**summary, CONTENT: content}
    return StagePart(key, seconds, time.time(), json.dumps(summary), __version__, settings)


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
    """Commits the part that was made since `begin_part`, and replaces the result in use.

    write_rows  writes other tables in the same transaction
    files       places of files that are not made at the places of `begin_part`
    settings    options as JSON, if later stages read them
    before      files of the replaced result, in addition to those in use
    also        keys of other parts that are made together with this one
    keep        whether the replaced result becomes the previous result of the stage
    """
    found, root = project.stage_results(), project.root
    # A part without `begin_part`, as in a project of an older version, keeps its present key.
    start = found.unfinished.get((stage, part)) or found.part(stage, part)
    parts = {part: _finished_part(project, stage, summary, "" if start is None else start.key, seconds, settings)}
    parts |= {other: _finished_part(project, stage, {}, key, 0.0) for other, key in (also or {}).items()}
    new = {name: place for name, place in found.made_at(stage, part).items() if part == 0 and (root / place).exists()}
    newest = found.places.get("cut/submaps")
    if stage == "floors" and part == 0 and newest is not None:
        new["cut/floors"] = newest
    replaced = found.in_use(stage, root) if part == 0 and keep else None
    if replaced is not None:
        replaced = StageResult(replaced.parts, {**replaced.files, **(before or {})})
    found = found.finished(stage, parts, new | dict(files or {}), replaced)
    with project.transaction() as c:
        results.write(c, found)
        if write_rows is not None:
            write_rows(c)
    results.remove_unreferenced_files(found, root)


# The models. If those in use belong to the newest cut into submaps, each new model replaces one of them. If they belong
# to a previous cut, new models are used only when all submaps of the newest cut are trained. -------------------------


def trained_key(project: Project, submap: int) -> str:
    """The key of the finished model of a submap in the newest cut, "" if there is none. The model may not be in use
    yet, because other submaps are still missing."""
    part = _newest(project.stage_results()).parts.get(submap)
    return "" if part is None else part.key


def _newest(found: StageResults) -> StageResult:
    """The finished models of the newest cut, which may not be in use yet."""
    if TRAIN not in found.stages_of_previous_cut:
        return found.get("in use", TRAIN) or StageResult()
    waiting, newest = found.get("next", TRAIN), found.places["cut/submaps"]
    if waiting is None or waiting.files.get("cut/train") != newest:
        return StageResult(files={"cut/train": newest})
    return waiting


def add_model(project: Project, submap: int, seconds: float, figures: dict[str, Any], batch: str) -> bool:
    """Commits a finished model from the place where it was made. Returns whether it is in use.

    A `batch` is all models that are trained with one configuration. The models in use before the first model of a batch
    are kept as the last result.
    """
    found, root = project.stage_results(), project.root
    work = found.unfinished.get((TRAIN, submap))
    part = _finished_part(project, TRAIN, figures, "" if work is None else work.key, seconds)
    files = found.made_at(TRAIN, submap)
    used, former = True, found.in_use(TRAIN, root)
    found = found.without_unfinished(TRAIN, submap)
    if TRAIN in found.stages_of_previous_cut:
        new = _newest(found)
        new = StageResult({**new.parts, submap: part}, {**new.files, **files})
        used = set(new.parts) >= {s.index for s in project.submaps()}
        if used:
            found = found.with_result("previous", TRAIN, former).with_result_in_use(TRAIN, new)
        found = found.with_result("next", TRAIN, None if used else new)
    else:
        before, in_use = None, found.get("in use", TRAIN) or StageResult()
        parts = in_use.parts
        if all(p.batch != batch for p in parts.values()) or (submap in parts and parts[submap].batch == batch):
            before = former
            earlier = {index: replace(part, batch="") for index, part in parts.items()}
            found = found.with_result("in use", TRAIN, StageResult(earlier, in_use.files))
        if "cut/submaps" in found.places:
            files["cut/train"] = found.places["cut/submaps"]
        found = found.finished(TRAIN, {submap: replace(part, batch=batch)}, files, before).with_result(
            "next", TRAIN, None
        )
    project.set_stage_results(found)
    remove_folder(project.layout.live_model(submap))
    project.layout.checkpoint(submap).unlink(missing_ok=True)
    results.remove_unreferenced_files(found, root)
    return used


def clear_unfinished(project: Project, of_others: Iterable[int]) -> None:
    """Removes checkpoints, partly trained models, and partly written files of killed processes. Keeps those of the
    submaps `of_others` whose training can be continued."""
    found, layout = project.stage_results(), project.layout
    left = {part for stage, part in found.unfinished if stage == TRAIN}
    wanted = left & set(of_others)
    project.set_stage_results(found := found.without_unfinished(TRAIN, *(left - wanted)))
    keep = {p for part in wanted for p in (layout.checkpoint(part), layout.live_model(part))}
    for path in [*layout.checkpoints.glob("submap_*.ckpt"), *layout.checkpoints.glob("live_*")]:
        if path in keep:
            continue
        if path.is_dir():
            remove_folder(path)
        else:
            path.unlink(missing_ok=True)
    for path in layout.checkpoints.glob(".*"):
        remove(path)
    results.remove_unreferenced_files(found, project.root)
