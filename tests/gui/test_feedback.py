"""Every action is answered in the status bar."""

from __future__ import annotations

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest

from nvsim.graph.selection import GraphSelection
from nvsim_app.state.document import Document
from nvsim_app.wiring.editing import past_tense
from nvsim_app.wiring.window import MainWindow


def said(window: MainWindow) -> str:
    return window.statusBar().currentMessage()


def some(document: Document, count: int) -> GraphSelection:
    return GraphSelection(frozenset(list(document.graph.viewpoints)[:count]))


def test_edits_undo_and_redo_say_what_they_did_and_the_key_that_takes_it_back(
    window: MainWindow, document: Document
) -> None:
    table = window.actions_table
    document.editing.select(some(document, 3))
    table["remove"].trigger()
    assert said(window) == "Removed 3 viewpoints · Ctrl+Z undoes"
    assert table["undo"].toolTip() == "Undo: remove 3 viewpoints (Ctrl+Z)"
    table["undo"].trigger()
    assert said(window) == "Undone: remove 3 viewpoints · Ctrl+Shift+Z redoes"
    assert table["redo"].toolTip() == "Redo: remove 3 viewpoints (Ctrl+Shift+Z)"
    table["redo"].trigger()
    assert said(window) == "Redone: remove 3 viewpoints · Ctrl+Z undoes"
    table["undo"].trigger()
    document.editing.select(some(document, 2))
    table["exclude"].trigger()
    assert said(window).startswith("Excluded 2 viewpoints")


def test_the_number_selected_stands_in_the_status_bar(window: MainWindow, document: Document) -> None:
    document.editing.select(some(document, 3))
    assert window._summary.text().startswith("3 viewpoints selected")
    document.editing.select(GraphSelection())
    assert "selected" not in window._summary.text()


def test_a_read_only_graph_says_so_in_the_title_and_when_an_edit_is_refused(
    window: MainWindow, document: Document
) -> None:
    assert "[read-only]" not in window.windowTitle()
    document.editing.locked = "another window edits this graph"
    document.editing.select(some(document, 1))
    document.editing.stepsChanged.emit()
    assert window.windowTitle() == "demo.nvsim[*] [read-only] – NVSim"
    window.scene.setFocus()
    QTest.keyClick(window.scene, Qt.Key.Key_Delete)
    assert said(window) == "Delete: unavailable, another window edits this graph."


@pytest.mark.parametrize(
    ("now", "then"),
    [("Remove 3 viewpoints", "Removed 3 viewpoints"), ("Copy 2", "Copied 2"), ("Set the height", "Set the height"),
     ("Take over", "Took over"), ("Align", "Aligned"), ("Split an edge", "Split an edge")],
)  # fmt: skip
def test_steps_are_told_in_the_past(now: str, then: str) -> None:
    assert past_tense(now) == then
