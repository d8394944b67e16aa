"""Evidence for an edge between two selected viewpoints, or between a viewpoint and the one under the cursor while an
edge is drawn."""

from __future__ import annotations

import demo_room
import numpy as np
import pytest
from editing_room import Hand
from PySide6.QtCore import QEvent, Qt
from PySide6.QtWidgets import QApplication

from nvsim.graph.selection import GraphSelection
from nvsim_app.modes.adding import AddEdgeMode
from nvsim_app.panels.details import DetailsPanel
from nvsim_app.state.directions import path_between
from nvsim_app.state.document import Document
from nvsim_app.wiring.window import MainWindow


def across_the_shelf(document: Document) -> tuple[str, str]:
    """Two viewpoints with the shelf between them."""
    arrays = document.graph_arrays
    low, high, _ = demo_room.FURNITURE[1]
    x, y = arrays.feet[:, 0], arrays.feet[:, 1]
    beside = abs(y - (low[1] + high[1]) / 2) < 1.4
    west = max(np.flatnonzero(beside & (x < low[0])), key=lambda i: x[i])
    east = min(np.flatnonzero((abs(y - y[west]) < 0.1) & (x > high[0])), key=lambda i: x[i])
    return arrays.ids[west], arrays.ids[east]


def test_two_selected_viewpoints_tell_why_there_is_no_edge(window: MainWindow, document: Document) -> None:
    a, b = across_the_shelf(document)
    document.editing.select(GraphSelection(frozenset({a, b})))
    panel = window.panels["details"]
    assert isinstance(panel, DetailsPanel)
    words = panel.words.text()
    assert "There is no edge" in words and "an obstacle is in the corridor" in words and "✗" in words
    assert panel.words.textFormat() == Qt.TextFormat.RichText
    assert panel.title.text().startswith("Between ")
    document.editing.run("add_edges", {"pairs": [[a, b]]})
    document.editing.select(GraphSelection(frozenset({a, b})))
    assert "There is an edge, although" in panel.words.text()


def test_the_line_that_is_drawn_says_it_as_well(
    window: MainWindow, document: Document, monkeypatch: pytest.MonkeyPatch
) -> None:
    a, b = across_the_shelf(document)
    document.editing.select(GraphSelection(frozenset({a})))
    mode = window.modes.modes["add_edge"]
    assert isinstance(mode, AddEdgeMode)
    window.actions_table["mode_add_edge"].trigger()
    hand = Hand(window, window.modes.canvases[1].surface)
    said: list[str] = []
    monkeypatch.setattr("nvsim_app.modes.adding.label", lambda painter, point, text, ink="": said.append(text))
    hand.hover(hand.foot(document.graph_arrays.index[b]))
    window.modes.canvases[1].grab()
    found = path_between(document, a, b)
    assert found is not None and any(found.sentence[:40] in text for text in said)
    free = document.graph.neighbors(a)[0]
    hand.hover(hand.foot(document.graph_arrays.index[free]))
    hand.key(Qt.Key.Key_Shift)
    assert path_between(document, a, free).support_of_edge == 1


@pytest.mark.parametrize("mode", ["add_edge", "add_viewpoint", "measure"])
def test_what_is_said_at_the_cursor_goes_when_the_cursor_leaves(
    window: MainWindow, document: Document, monkeypatch: pytest.MonkeyPatch, mode: str
) -> None:
    canvas = window.modes.canvases[1]
    window.actions_table[f"mode_{mode}"].trigger()
    hand = Hand(window, canvas.surface)
    said: list[str] = []
    module = "measure" if mode == "measure" else "adding"
    monkeypatch.setattr(f"nvsim_app.modes.{module}.label", lambda painter, point, text, ink="": said.append(text))
    hand.hover(hand.foot(0))
    canvas.grab()
    assert said
    QApplication.sendEvent(canvas.surface.widget, QEvent(QEvent.Type.Leave))
    said.clear()
    canvas.grab()
    assert not said
