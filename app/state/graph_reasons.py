"""The conditions of edits: functions of the document that return why an edit is not possible, or None if it is."""

from __future__ import annotations

from collections.abc import Callable

from app.state.document import Document
from app.state.graph_files import ForeignGraph
from app.state.reasons import UNDECIDED, Reason
from nvsim.graph.offers import Needs

Check = Callable[[Document], Reason]


def with_editing(document: Document) -> Reason:
    """Needs an open graph, which may be read-only."""
    if document.contents.outline is not None:
        return UNDECIDED
    return None if document.editing.history is not None else "no navigation graph is open"


def writable(document: Document) -> Reason:
    return with_editing(document) or document.editing.locked or None


def with_chosen(needs: Needs, *, changes: bool = True) -> Check:
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


def with_file_of_its_own(document: Document) -> Reason:
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
