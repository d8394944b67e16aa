"""All displayed values belong to the graph on screen and to the open file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import demo_room
import pytest
from editing_room import Hand
from PySide6.QtCore import QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from nvsim.graph.selection import GraphSelection
from nvsim_app.modes.mode import Pointer
from nvsim_app.painting import cameras
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.modes import ContextPart
from nvsim_app.wiring.proposing import ProposePart
from nvsim_app.wiring.window import MainWindow


@pytest.fixture
def hand(window: MainWindow) -> Hand:
    window.scene.navigation.set_pose(cameras.top_view(window.document.extent, 1.4))
    QApplication.processEvents()
    return Hand(window, window.modes.canvases[0].surface)


def menu_of(hand: Hand, row: int) -> list[str]:
    point = QPointF(hand.pixel(hand.foot(row)))
    menu = hand.window.part(ContextPart).menu(Pointer(hand.surface, point, Qt.KeyboardModifier.NoModifier))
    words = [action.text().replace("&", "") for action in menu.actions() if action.text()]
    menu.deleteLater()
    return words


def test_a_doubtful_edge_is_forgotten_when_the_move_is_undone(window: MainWindow, document: Document) -> None:
    part = window.part(ProposePart)
    key = next(iter(document.graph.edges))
    document.editing.run("shift_viewpoints", {"ids": [key[0]], "by": [0.1, 0.0, 0.0]})
    part.proposals.add(document.graph, (), (key,))
    document.editing.run("mark_reviewed", {"viewpoints": [key[1]], "edges": []})
    assert part.proposals.doubted == (key,)
    document.editing.undo()
    assert part.proposals.doubted == (key,)
    document.editing.undo()
    assert not part.proposals.doubted


def test_a_doubtful_edge_is_forgotten_when_a_job_replaces_the_graph(window: MainWindow, document: Document) -> None:
    part = window.part(ProposePart)
    graph, key = document.graph, next(iter(document.graph.edges))
    part.proposals.add(graph, (), (key,))
    without = replace(graph, edges={k: edge for k, edge in graph.edges.items() if k != key})
    document.editing.locked = "A job builds the map."  # then the graph is opened anew
    document.set_contents(replace(document.contents, graph=without))
    assert document.graph.edges.keys() == without.edges.keys() and not part.proposals.doubted


def test_a_label_at_the_mouse_pointer_ends_with_its_file(hand: Hand) -> None:
    modes = hand.window.modes
    modes.choose("add_edge")
    hand.hover(hand.foot(5))
    assert modes.current._now is not None
    hand.document.set_contents(Contents(Path("other.nvsim")))
    assert modes.current._now is None and all(canvas.cursor_at is None for canvas in modes.canvases)
    hand.document.set_contents(demo_room.contents(Path("demo.nvsim")))


def test_texts_that_filter_a_list_end_with_their_file(window: MainWindow, document: Document) -> None:
    panels = window.panels
    fields = (panels["tables"].filter, panels["validation"].text, panels["frames"].search)
    window.actions_table["workspace_edit"].trigger()
    for field in fields:
        QTest.keyClicks(field, "degree > 99")
    panels["tables"].refresh.finish()
    assert panels["tables"].viewpoints.rowCount() == 0
    document.set_contents(demo_room.contents(Path("other.nvsim")))
    panels["tables"].refresh.finish()
    assert not any(field.text() for field in fields)
    assert panels["tables"].viewpoints.rowCount() == len(document.graph.viewpoints)


def test_the_context_menu_offers_lock_or_unlock_and_connect(hand: Hand) -> None:
    id = hand.document.graph_arrays.ids[5]
    hand.document.editing.select(GraphSelection(frozenset({id})))
    words = menu_of(hand, 5)
    assert "Lock" in words and "Unlock" not in words and "Connect to…" in words
    hand.document.editing.run("lock", {"viewpoints": [id], "edges": [], "locked": True})
    words = menu_of(hand, 5)
    assert "Unlock" in words and "Lock" not in words


def test_after_a_query_the_keys_act_on_the_selection(window: MainWindow, document: Document) -> None:
    panel = window.panels["tables"]
    window.activateWindow()
    window.actions_table["select_expression"].trigger()
    panel.filter.setText("degree > 100 and")
    QTest.keyClick(panel.filter, Qt.Key.Key_Return)
    assert window.focusWidget() is panel.filter, "the expression has an error"
    panel.filter.setText("degree >= 4")
    QTest.keyClick(panel.filter, Qt.Key.Key_Return)
    chosen = document.editing.selection.viewpoints
    assert chosen and window.focusWidget() is window.scene
    QTest.keyClick(window.focusWidget(), Qt.Key.Key_Delete)
    assert not chosen & document.graph.viewpoints.keys()
