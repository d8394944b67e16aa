"""Why an edit cannot be made now, in words; None when it can."""

from __future__ import annotations

from collections.abc import Callable

from app.state.document import Document
from app.state.graph_files import ForeignGraph
from app.state.reasons import UNDECIDED, Reason

Check = Callable[[Document], Reason]


def with_editing(document: Document) -> Reason:
    """There is a graph, whether it may be changed or not."""
    if document.contents.outline is not None:
        return UNDECIDED
    return None if document.editing.history is not None else "no navigation graph is open"


def writable(document: Document) -> Reason:
    return with_editing(document) or document.editing.locked or None


def with_things(document: Document) -> Reason:
    """Something in the graph is selected."""
    chosen = document.editing.selection
    return writable(document) or (None if chosen.viewpoints or chosen.edges else "nothing in the graph is selected")


def selected(document: Document) -> Reason:
    """As with_things, where nothing is changed."""
    chosen = document.editing.selection
    return with_editing(document) or (None if chosen.viewpoints or chosen.edges else "nothing in the graph is selected")


def viewpoints(least: int, most: int | None = None, *, changes: bool = True) -> Check:
    """Between `least` and `most` viewpoints are selected."""

    def reason(document: Document) -> Reason:
        count = len(document.editing.selection.viewpoints)
        first = writable(document) if changes else with_editing(document)
        if first is not None or (count >= least and (most is None or count <= most)):
            return first
        wanted = f"{least}" if most == least else f"at least {least}" if most is None else f"{least} to {most}"
        noun = "viewpoint" if wanted.endswith("1") and wanted != "at least 1" else "viewpoints"
        return f"{wanted} selected {noun} needed, there {'is' if count == 1 else 'are'} {count or 'none'}"

    return reason


def edges(least: int, most: int | None = None) -> Check:
    """Between `least` and `most` edges are selected."""

    def reason(document: Document) -> Reason:
        count = len(document.editing.selection.edges)
        if (first := writable(document)) is not None or (count >= least and (most is None or count <= most)):
            return first
        wanted = f"{least}" if most == least else f"at least {least}"
        noun = "edge" if least == 1 else "edges"
        return f"{wanted} selected {noun} needed, there {'is' if count == 1 else 'are'} {count or 'none'}"

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
        return "there is no file to save it to"
    return None if document.editing.dirty else "everything is saved"


def with_file_of_its_own(document: Document) -> Reason:
    file = document.contents.graph_file
    return None if isinstance(file, ForeignGraph) else "the graph is not a file of its own; File > Export writes one"


def with_scans(document: Document) -> Reason:
    file = document.contents.graph_file
    many = isinstance(file, ForeignGraph) and len(file.scans) > 1
    return None if many else "the graph is not one of several in a folder"


def with_map(document: Document) -> Reason:
    """There is a map to look for places on."""
    known = document.contents.occupancy is not None
    return writable(document) or (None if known else "there is no map of what is free")
