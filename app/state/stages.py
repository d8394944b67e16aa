"""The stages of the work that can be started from the window: what each is called, and what it needs. Knows no Qt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from app.state.document import Document
from app.state.reasons import Reason, with_graph, with_scene, with_trajectory


def _pending(document: Document) -> bool:
    """Whether something is under way that may make what is missing."""
    return document.jobs is not None and any(h.state in ("running", "queued") for h in document.jobs.handles)


def with_capture(document: Document) -> Reason:
    if document.project is None:
        return "no project is open"
    return None if document.contents.capture is not None or _pending(document) else with_trajectory(document)


def with_submaps(document: Document) -> Reason:
    if document.project is None or _pending(document) or document.contents.submaps:
        return with_capture(document)
    return "the trajectory is not divided into submaps yet"


def with_floors(document: Document) -> Reason:
    reason = with_submaps(document)
    if reason is not None or _pending(document) or "floors" in document.contents.stages:
        return reason
    return "the floor is not found yet"


def with_models(document: Document) -> Reason:
    if document.project is None:
        return "no project is open"
    return None if _pending(document) else with_scene(document)


def with_map(document: Document) -> Reason:
    if document.project is None:
        return "no project is open"
    return None if _pending(document) else with_graph(document)


@dataclass(frozen=True)
class Stage:
    """A command of the command line as the window offers it."""

    verb: str
    title: str
    needs: Callable[[Document], Reason]
    heavy: bool = True


STAGES: dict[str, Stage] = {
    stage.verb: stage
    for stage in (
        Stage("submaps", "Cut into submaps", with_capture),
        Stage("floors", "Find the floor", with_submaps),
        Stage("train", "Train", with_floors),
        Stage("map", "Build the map", with_models),
        Stage("evaluate views", "Evaluate views", with_models),
        Stage("evaluate floor", "Evaluate floor masks", with_floors),
        Stage("evaluate graph", "Evaluate the graph", with_map, heavy=False),
        Stage("evaluate ablation", "Run the ablation", with_floors),
        Stage("export r2r", "Export R2R", with_map, heavy=False),
        Stage("export splats", "Export splats", with_models, heavy=False),
    )
}
PIPELINE = ("submaps", "floors", "train", "map")
EVALUATIONS = ("evaluate views", "evaluate floor", "evaluate graph", "evaluate ablation")
GIVES_RESULT = frozenset(EVALUATIONS)
"""Commands that print figures, which is why they are asked for them in JSON."""
