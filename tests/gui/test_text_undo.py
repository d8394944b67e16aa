"""Ctrl+Z undoes the text of a field with changes, and otherwise the last edit of the graph."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import demo_room
import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QWidget

from nvsim.graph.selection import GraphSelection
from nvsim_app.state.document import Document
from nvsim_app.wiring.editing import EditPart
from nvsim_app.wiring.window import MainWindow

CTRL = Qt.KeyboardModifier.ControlModifier
CTRL_SHIFT = CTRL | Qt.KeyboardModifier.ShiftModifier


@pytest.fixture
def edited(window: MainWindow, document: Document) -> MainWindow:
    """The window after a viewpoint was locked."""
    window.activateWindow()
    document.editing.select(GraphSelection(frozenset(document.graph_arrays.ids[:1])))
    window.actions_table["lock"].trigger()
    assert window.statusBar().currentMessage().endswith("Ctrl+Z undoes")
    return window


def locked(window: MainWindow) -> bool:
    return any(viewpoint.locked for viewpoint in window.document.graph.viewpoints.values())


def undo(widget: QWidget, keys: Qt.KeyboardModifier = CTRL) -> None:
    widget.setFocus()
    QApplication.processEvents()
    assert QApplication.focusWidget() is widget and QApplication.activeWindow() is widget.window()
    assert QApplication.activePopupWidget() is None
    QTest.keyClick(widget, Qt.Key.Key_Z, keys)


def state(window: MainWindow) -> object:
    """The values that decide whether the window can undo a step."""
    history, action = window.document.editing.history, window.actions_table["undo"]
    assert history is not None
    steps = [step.text for step in history.steps]
    return steps, history.index, action.isEnabled(), action.shortcut().toString(), QApplication.focusWidget()


def test_a_text_field_undoes_its_text_first(edited: MainWindow) -> None:
    edited.show_dock("tables")
    field = edited.panels["tables"].filter
    field.setFocus()
    QTest.keyClicks(field, "degree")
    undo(field)
    assert field.text() == "" and locked(edited)
    undo(field)
    assert not locked(edited)
    undo(field, CTRL_SHIFT)
    assert field.text() == "degree" and not locked(edited)
    undo(field, CTRL_SHIFT)
    assert locked(edited)


def test_a_list_a_button_and_the_view_undo_the_graph(edited: MainWindow) -> None:
    edited.show_dock("history")
    for widget in (edited.scene, edited.panels["history"].list, edited.panels["tables"].filter):
        edited.show_dock("tables" if widget is edited.panels["tables"].filter else "history")
        undo(widget)
        assert not locked(edited), (widget, state(edited))
        edited.actions_table["redo"].trigger()


def test_a_form_beside_the_window_undoes_the_graph(edited: MainWindow) -> None:
    edited.actions_table["set_height"].trigger()
    form = edited.part(EditPart).form
    assert form is not None
    form.activateWindow()
    for widget in (form.inputs["height"], form.apply):
        undo(widget)
        assert not locked(edited), (widget, state(edited))
        undo(widget, CTRL_SHIFT)
        assert locked(edited), (widget, state(edited))
    form.close()


def test_the_status_bar_forgets_the_key_when_it_undoes_another_step(edited: MainWindow, document: Document) -> None:
    document.editing.select(GraphSelection(frozenset(document.graph_arrays.ids[1:3])))
    assert "undoes" not in edited.statusBar().currentMessage()


def test_of_two_windows_the_focused_one_undoes(
    edited: MainWindow, make_window: Callable[[Document], MainWindow]
) -> None:
    other = Document()
    other.set_contents(demo_room.contents(Path("demo.nvsim")))
    second = make_window(other)
    second.activateWindow()
    other.editing.select(GraphSelection(frozenset(other.graph_arrays.ids[:1])))
    second.actions_table["lock"].trigger()
    undo(second.scene)
    assert not locked(second) and locked(edited)
