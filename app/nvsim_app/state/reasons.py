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


def never_disabled(document: Document) -> Reason:
    return None


def with_project(document: Document) -> Reason:
    return None if document.path else "no project is open"


def with_positions(document: Document) -> Reason:
    return None if len(document.extent) else "the project has neither a trajectory nor a graph yet"


def with_places(document: Document) -> Reason:
    """Needs frames or viewpoints."""
    if document.contents.outline is not None:
        return UNDECIDED
    return with_positions(document)


def with_project_folder(document: Document) -> Reason:
    """Needs a project, not a splat file or a graph file."""
    return None if document.project is not None else "no project is open"


def with_results(document: Document) -> Reason:
    return None if document.contents.results else "there are no evaluation results yet"


def with_evidence(document: Document) -> Reason:
    """Needs the graph of a project, which has evidence."""
    if (first := with_graph(document)) is not None:
        return first
    return None if document.project is not None else "a graph file contains no evidence for new decisions"


def with_scene(document: Document) -> Reason:
    return None if document.contents.scene_stamp is not None else STAGE["train"].missing


def with_submaps(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return with_scene(document)


def with_graph(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return None if document.graph is not None else STAGE["map"].missing


def with_trajectory(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return None if len(document.trajectory.positions) else STAGE["import"].missing


def with_occupancy(document: Document) -> Reason:
    return None if document.contents.occupancy is not None else "the project has no occupancy map yet"


def with_splat_file(document: Document) -> Reason:
    return None if document.contents.outline is not None else "only a splat file can be turned upright"


def with_earlier_result(document: Document) -> Reason:
    kept = document.contents.restorable_stages
    return None if kept else "there is no earlier result yet; each new run of a stage stores the previous result"


def with_training(document: Document) -> Reason:
    jobs = () if document.jobs is None else document.jobs.handles
    return None if any(h.job.order.verb in TRAININGS for h in jobs) else "this project has no training jobs"


def with_frame(document: Document) -> Reason:
    return None if document.frame_at_hand is not None else "no frame is selected"


def with_frame_page(document: Document) -> Reason:
    return None if document.page_frame is not None else "the 3D view is already shown"


def with_masks(document: Document) -> Reason:
    """Needs a frame, floor masks, and a writable project folder, because corrections are files in it."""
    if document.frame_at_hand is None or document.path is None:
        return "no frame is selected"
    if "floors" not in document.contents.stages and not Layout(document.path).masks.is_dir():
        return STAGE["floors"].missing
    return None if os.access(document.path, os.W_OK) else "the project folder is not writable"


Check = Callable[[Document], Reason]


def with_editing(document: Document) -> Reason:
    """Needs an open graph, which may be read-only."""
    if document.contents.outline is not None:
        return UNDECIDED
    return None if document.editing.history is not None else "no navigation graph is open"


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


def depth_or_job(document: Document) -> Reason:
    reason = capture_or_job(document)
    if reason is not None or _pending(document) or "depth" in document.contents.stages:
        return reason
    return STAGE["depth"].missing


def floors_or_job(document: Document) -> Reason:
    reason = submaps_or_job(document)
    if reason is not None or _pending(document) or "floors" in document.contents.stages:
        return reason
    return STAGE["floors"].missing


def models_or_job(document: Document) -> Reason:
    if document.project is None:
        return _without_project(document)
    return None if _pending(document) else with_scene(document)


def map_or_job(document: Document) -> Reason:
    if document.project is None:
        return _without_project(document)
    return None if _pending(document) else with_graph(document)


_WITH: dict[StageName, Callable[[Document], Reason]] = {
    "import": capture_or_job,
    "submaps": submaps_or_job,
    "depth": depth_or_job,
    "floors": floors_or_job,
    "train": models_or_job,
    "map": map_or_job,
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
