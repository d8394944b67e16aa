"""Small screens: the window, its dialogs and its sentences."""

from __future__ import annotations

from dataclasses import replace

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QPushButton, QWidget
from pytestqt.qtbot import QtBot

from app.look.wrapping import WrappingRow
from app.panels.details import DetailsPanel
from app.panels.help import open_help
from app.state.document import Document
from app.wiring.arrangements import ARRANGEMENTS
from app.wiring.window import MainWindow
from nvsim.graph.selection import GraphSelection


def test_the_window_fits_half_of_a_screen_of_1920_pixels(window: MainWindow) -> None:
    assert window.minimumSizeHint().width() <= 960
    for arrangement in ARRANGEMENTS:
        window.actions_table[f"workspace_{arrangement.id}"].trigger()
        assert window.minimumSizeHint().width() <= 960, arrangement.id


def test_a_row_without_room_goes_on_in_the_next_line(qtbot: QtBot) -> None:
    holder = QWidget()
    qtbot.addWidget(holder)
    row = WrappingRow(holder)
    buttons = [QPushButton(text, holder) for text in ("one", "two", "three")]
    for button in buttons:
        row.addWidget(button)
    width = sum(button.sizeHint().width() for button in buttons)
    assert row.heightForWidth(width + 40) < row.heightForWidth(width - 40)
    buttons[1].hide()
    assert row.heightForWidth(width - 40) == row.heightForWidth(width + 40)


def test_long_words_in_details_go_on_in_the_next_line(window: MainWindow, document: Document) -> None:
    panel = window.panels["details"]
    assert isinstance(panel, DetailsPanel)
    bare = replace(document.contents.graph, evidence={})
    document.set_contents(replace(document.contents, graph=bare))
    key = next(iter(bare.edges))
    document.editing.select(GraphSelection(frozenset(), frozenset({key})))
    words = [label for label in panel.findChildren(QLabel) if "nothing was measured" in label.text()]
    assert words and all(label.wordWrap() for label in words)


def test_a_dialog_has_the_keyboard_and_escape_closes_it(window: MainWindow, qtbot: QtBot) -> None:
    page = open_help("keys", window)
    qtbot.waitUntil(lambda: page.isActiveWindow() and page.focusWidget() is not None, timeout=3000)
    qtbot.keyClick(page.focusWidget(), Qt.Key.Key_Escape)
    assert not page.isVisible()


def test_how_many_are_reviewed_is_said_of_the_graph_as_it_is(window: MainWindow, document: Document) -> None:
    table = window.actions_table
    table["next_review"].trigger()
    assert " 0 of " in window.statusBar().currentMessage()
    table["reviewed"].trigger()
    assert " 1 of " in window.statusBar().currentMessage()
    table["undo"].trigger()
    assert " 0 of " in window.statusBar().currentMessage()
