"""The conditions of commands: functions of the document that return why a command is unavailable, or None."""

from __future__ import annotations

import os

from app.state.document import Document
from nvsim.project.layout import Layout
from nvsim.project.work import STAGE

Reason = str | None  # why a command is unavailable, None if it is available


TRAININGS = ("train", "run", "demo", "r2r train")
"""The commands that report training curves."""
UNDECIDED = "a splat file is open, which has no trajectory and no graph"


def always(document: Document) -> Reason:
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


def with_measured(document: Document) -> Reason:
    """Needs the graph of a project, which has evidence."""
    if (first := with_graph(document)) is not None:
        return first
    return None if document.project is not None else "a graph file contains no evidence for new decisions"


def with_scene(document: Document) -> Reason:
    return None if document.contents.scene_stamp is not None else STAGE["train"].lacking


def with_submaps(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return with_scene(document)


def with_graph(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return None if document.graph is not None else STAGE["map"].lacking


def with_trajectory(document: Document) -> Reason:
    if document.contents.outline is not None:
        return UNDECIDED
    return None if len(document.trajectory.positions) else STAGE["import"].lacking


def with_occupancy(document: Document) -> Reason:
    return None if document.contents.occupancy is not None else "the project has no occupancy map yet"


def with_splat_file(document: Document) -> Reason:
    return None if document.contents.outline is not None else "only a splat file can be turned upright"


def with_earlier(document: Document) -> Reason:
    kept = document.contents.kept
    return None if kept else "there is no earlier result yet; each new run of a stage stores the previous result"


def with_training(document: Document) -> Reason:
    jobs = () if document.jobs is None else document.jobs.handles
    return None if any(h.job.order.verb in TRAININGS for h in jobs) else "this project has no training jobs"


def with_frame(document: Document) -> Reason:
    return None if document.frame_at_hand is not None else "no frame is selected"


def with_page(document: Document) -> Reason:
    return None if document.page_frame is not None else "the 3D view is already shown"


def with_masks(document: Document) -> Reason:
    """Needs a frame, floor masks, and a writable project folder, because corrections are files in it."""
    if document.frame_at_hand is None or document.path is None:
        return "no frame is selected"
    if "floors" not in document.contents.stages and not Layout(document.path).masks.is_dir():
        return STAGE["floors"].lacking
    return None if os.access(document.path, os.W_OK) else "the project folder is not writable"
