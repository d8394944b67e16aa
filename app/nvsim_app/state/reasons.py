"""The conditions of commands: functions of the document that return why a command is unavailable, or None."""

from __future__ import annotations

import os
from collections.abc import Callable

from nvsim.graph.offers import SelectionNeeds
from nvsim.project.layout import Layout
from nvsim.project.work import NEEDS_IMAGES, NO_IMAGES, STAGE, WORK, StageName
from nvsim_app.state.document import Document
from nvsim_app.state.graph_files import ForeignGraph

Reason = str | None  # why a command is unavailable, None if it is available


TRAININGS = ("train", "run", "demo", "r2r train")
"""The commands that report training curves."""
UNDECIDED = "a splat file is open, which has no trajectory and no graph"


Check = Callable[[Document], Reason]


def never_disabled(document: Document) -> Reason:
    return None


def _needs(found: Callable[[Document], object], why: str, no_splats: bool = False) -> Check:
    """A condition that holds if `found` returns a true value; with `no_splats`, only if no splat file is open."""

    def reason(document: Document) -> Reason:
        if no_splats and document.contents.outline is not None:
            return UNDECIDED
        return None if found(document) else why

    return reason


def _trains(document: Document) -> bool:
    jobs = () if document.jobs is None else document.jobs.handles
    return any(h.job.order.verb in TRAININGS for h in jobs)


_NOTHING = "the project has neither a trajectory nor a graph yet"
with_project = _needs(lambda d: d.path, "no project is open")
with_positions = _needs(lambda d: len(d.extent), _NOTHING)
with_places = _needs(lambda d: len(d.extent), _NOTHING, no_splats=True)
with_project_folder = _needs(lambda d: d.project, "no project is open")  # not a splat file or a graph file
with_results = _needs(lambda d: d.contents.results, "there are no evaluation results yet")
with_scene = _needs(lambda d: d.contents.scene_stamp is not None, STAGE["train"].missing)
with_submaps = _needs(lambda d: d.contents.scene_stamp is not None, STAGE["train"].missing, no_splats=True)
with_graph = _needs(lambda d: d.graph is not None, STAGE["map"].missing, no_splats=True)
with_trajectory = _needs(lambda d: len(d.trajectory.positions), STAGE["import"].missing, no_splats=True)
with_occupancy = _needs(lambda d: d.contents.occupancy is not None, "the project has no occupancy map yet")
with_splat_file = _needs(lambda d: d.contents.outline is not None, "only a splat file can be turned upright")
with_earlier_result = _needs(
    lambda d: d.contents.restorable_stages,
    "there is no earlier result yet; each new run of a stage stores the previous result",
)
with_training = _needs(_trains, "this project has no training jobs")
with_frame = _needs(lambda d: d.frame_at_hand is not None, "no frame is selected")
with_frame_page = _needs(lambda d: d.page_frame is not None, "the 3D view is already shown")
with_editing = _needs(lambda d: d.editing.history is not None, "no navigation graph is open", no_splats=True)
"""Needs an open graph, which may be read-only."""


def with_evidence(document: Document) -> Reason:
    """Needs the graph of a project, which has evidence."""
    no_project = None if document.project is not None else "a graph file contains no evidence for new decisions"
    return with_graph(document) or no_project


def with_masks(document: Document) -> Reason:
    """Needs a frame, floor masks, and a writable project folder, because corrections are files in it."""
    if document.frame_at_hand is None or document.path is None:
        return "no frame is selected"
    if "floors" not in document.contents.stages and not Layout(document.path).masks.is_dir():
        return STAGE["floors"].missing
    return None if os.access(document.path, os.W_OK) else "the project folder is not writable"


def writable(document: Document) -> Reason:
    return with_editing(document) or document.editing.locked or None


def with_selection(needs: SelectionNeeds, *, changes: bool = True) -> Check:
    """Needs a selection that satisfies `needs`, and a writable graph if the command `changes` it."""

    def reason(document: Document) -> Reason:
        chosen = document.editing.selection
        first = writable(document) if changes else with_editing(document)
        return first or needs.reason(len(chosen.viewpoints), len(chosen.edges))

    return reason


def can_undo(document: Document) -> Reason:
    history = document.editing.history
    return writable(document) or (None if history is not None and history.index > 0 else "there is nothing to undo")


def can_redo(document: Document) -> Reason:
    history = document.editing.history
    more = history is not None and history.redo_text is not None
    return writable(document) or (None if more else "there is nothing to redo")


def can_save(document: Document) -> Reason:
    if (first := writable(document)) is not None:
        return first
    if document.editing.file is None:
        return "the graph has no file to save to"
    return None if document.editing.dirty else "everything is saved"


def with_graph_file(document: Document) -> Reason:
    file = document.contents.graph_file
    return None if isinstance(file, ForeignGraph) else "the graph is part of a project; File > Export writes a file"


def with_scans(document: Document) -> Reason:
    file = document.contents.graph_file
    many = isinstance(file, ForeignGraph) and len(file.scans) > 1
    return None if many else "the folder contains no other graph"


def with_map(document: Document) -> Reason:
    """Needs a writable graph and an occupancy map."""
    known = document.contents.occupancy is not None
    return writable(document) or (None if known else "there is no occupancy map")


def _pending(document: Document) -> bool:
    """Whether a running or queued job may create the missing result."""
    return document.jobs is not None and any(h.state in ("running", "queued") for h in document.jobs.handles)


def _without_project(document: Document) -> str:
    if document.contents.outline is not None:
        return UNDECIDED
    return "a graph file is open, not a project" if document.path else "no project is open"


def capture_or_job(document: Document) -> Reason:
    if document.project is None:
        return _without_project(document)
    return None if document.contents.capture is not None or _pending(document) else with_trajectory(document)


def submaps_or_job(document: Document) -> Reason:
    if document.project is None or _pending(document) or document.contents.submaps:
        return capture_or_job(document)
    return STAGE["submaps"].missing


def _stage_or_job(stage: StageName, before: Check) -> Check:
    """Needs the result of a stage, or a job that may create it. `before` is the condition of the stage before it."""

    def reason(document: Document) -> Reason:
        first = before(document)
        found = first is not None or _pending(document) or stage in document.contents.stages
        return first if found else STAGE[stage].missing

    return reason


def _result_or_job(found: Check) -> Check:
    def reason(document: Document) -> Reason:
        if document.project is None:
            return _without_project(document)
        return None if _pending(document) else found(document)

    return reason


models_or_job = _result_or_job(with_scene)
_WITH: dict[StageName, Callable[[Document], Reason]] = {
    "import": capture_or_job,
    "submaps": submaps_or_job,
    "depth": _stage_or_job("depth", capture_or_job),
    "floors": _stage_or_job("floors", submaps_or_job),
    "train": models_or_job,
    "map": _result_or_job(with_graph),
}


def reason_of_command(verb: str) -> Callable[[Document], Reason]:
    """A function that returns why `nvsim VERB` cannot begin on a document, or None."""
    row = WORK[verb]
    needed = never_disabled if row.needs is None else _WITH[row.needs]
    if verb in NEEDS_IMAGES:
        return lambda document: needed(document) if document.contents.has_images else NO_IMAGES
    if not row.renders_models:
        return needed
    return lambda document: needed(document) or models_or_job(document)
