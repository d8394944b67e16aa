"""The conditions of commands that need the result of a stage: functions of the document that return why a command
cannot begin, or None."""

from __future__ import annotations

from collections.abc import Callable

from app.state.document import Document
from app.state.reasons import UNDECIDED, Reason, always, with_graph, with_scene, with_trajectory
from nvsim.project.work import NEEDS_IMAGES, NO_IMAGES, STAGE, WORK, StageName


def _pending(document: Document) -> bool:
    """Whether a running or queued job may create the missing result."""
    return document.jobs is not None and any(h.state in ("running", "queued") for h in document.jobs.handles)


def _without_project(document: Document) -> str:
    if document.contents.outline is not None:
        return UNDECIDED
    return "a graph file is open, not a project" if document.path else "no project is open"


def with_capture(document: Document) -> Reason:
    if document.project is None:
        return _without_project(document)
    return None if document.contents.capture is not None or _pending(document) else with_trajectory(document)


def with_submaps(document: Document) -> Reason:
    if document.project is None or _pending(document) or document.contents.submaps:
        return with_capture(document)
    return STAGE["submaps"].lacking


def with_depth(document: Document) -> Reason:
    reason = with_capture(document)
    if reason is not None or _pending(document) or "depth" in document.contents.stages:
        return reason
    return STAGE["depth"].lacking


def with_floors(document: Document) -> Reason:
    reason = with_submaps(document)
    if reason is not None or _pending(document) or "floors" in document.contents.stages:
        return reason
    return STAGE["floors"].lacking


def with_models(document: Document) -> Reason:
    if document.project is None:
        return _without_project(document)
    return None if _pending(document) else with_scene(document)


def with_map(document: Document) -> Reason:
    if document.project is None:
        return _without_project(document)
    return None if _pending(document) else with_graph(document)


_WITH: dict[StageName, Callable[[Document], Reason]] = {
    "import": with_capture,
    "submaps": with_submaps,
    "depth": with_depth,
    "floors": with_floors,
    "train": with_models,
    "map": with_map,
}


def enabled(verb: str) -> Callable[[Document], Reason]:
    """A function that returns why `nvsim VERB` cannot begin on a document, or None."""
    row = WORK[verb]
    needed = always if row.needs is None else _WITH[row.needs]
    if verb in NEEDS_IMAGES:
        return lambda document: needed(document) if document.contents.has_images else NO_IMAGES
    if not row.draws:
        return needed
    return lambda document: needed(document) or with_models(document)
