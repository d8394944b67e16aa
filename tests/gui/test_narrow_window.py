"""Small screens: the window, its dialogs and its sentences."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import pytest
from PySide6.QtCore import QSize, Qt
from PySide6.QtWidgets import QDialog, QDialogButtonBox, QLabel, QPushButton, QWidget
from pytestqt.qtbot import QtBot

from nvsim.graph.selection import GraphSelection
from nvsim_app.look.labels import WrappingRow
from nvsim_app.look.widgets import Dialog
from nvsim_app.panels.details import DetailsPanel
from nvsim_app.panels.help import open_help
from nvsim_app.state.document import Contents, Document
from nvsim_app.wiring.window import MainWindow
from nvsim_app.wiring.workspace_layouts import WORKSPACE_LAYOUTS


def test_the_window_fits_half_of_a_screen_of_1920_pixels(window: MainWindow) -> None:
    assert window.minimumSizeHint().width() <= 960
    for layout in WORKSPACE_LAYOUTS:
        window.actions_table[f"workspace_{layout.id}"].trigger()
        assert window.minimumSizeHint().width() <= 960, layout.id


def test_panels_of_a_small_window_do_not_cover_each_other(window: MainWindow, qtbot: QtBot) -> None:
    window.show()
    window.resize(960, 540)
    for layout in WORKSPACE_LAYOUTS:
        window.actions_table[f"workspace_{layout.id}"].trigger()
        window.actions_table["reset_layout"].trigger()
        qtbot.wait(50)
        docks = [d for d in window.docks.values() if d.isVisible() and not d.visibleRegion().isEmpty()]
        areas = [window.center.geometry(), *(dock.geometry() for dock in docks)]
        areas = [area for area in areas if window.rect().intersects(area)]  # Qt moves docks behind tabs out of sight
        assert all(window.rect().contains(area) for area in areas), layout.id
        assert not [1 for a, b in combinations(areas, 2) if a.intersects(b)], layout.id
        main = window.docks[layout.main] if layout.main else window.center
        assert main.width() >= 340, layout.id
        if layout.main:
            assert main.height() > 0.75 * window.height(), layout.id


def test_a_row_without_room_goes_on_in_the_next_line(qtbot: QtBot) -> None:
    holder = QWidget()
    qtbot.addWidget(holder)
    row = WrappingRow(on=holder)
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
    words = [label for label in panel.findChildren(QLabel) if "was not measured" in label.text()]
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


def test_at_twice_the_size_everything_fits_a_screen_of_1920_by_1080(tmp_path: Path) -> None:
    """In a process of its own: Qt reads its scale once. Logical pixels of window and dialogs, as small as they get,
    whichever panels are in front."""
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); from pathlib import Path\n"
        "from PySide6.QtCore import QSettings; from PySide6.QtWidgets import QApplication, QDialog\n"
        "from nvsim_app.start.application import make_application\n"
        "settings = QSettings(sys.argv[2], QSettings.Format.IniFormat); app = make_application('dark', settings)\n"
        "import demo_room; from nvsim_app.look.notices import Notices; from nvsim_app.state.document import Document\n"
        "from nvsim_app.wiring.window import MainWindow\n"
        "document = Document(); window = MainWindow(document, settings, Notices()); window.show()\n"
        "document.set_contents(demo_room.contents(Path('demo.nvsim')))\n"
        "document.select(viewpoint=document.graph_arrays.ids[0])\n"
        "def settle():\n"
        "    for _ in range(5): app.processEvents()\n"
        "sizes = []\n"
        "for name in ('tasks', 'agent', 'camera_path', 'frame'):  # what is behind a tab counts as well\n"
        "    if name == 'frame': document.select(frame=0); window.actions_table['open_frame'].trigger()\n"
        "    else: window.show_dock(name)\n"
        "    settle(); window.resize(1, 1); settle()\n"
        "    sizes.append((window.width(), window.height(), name))\n"
        "for name in ('preferences', 'help', 'new_project', 'models', 'job_train', 'export_graph', 'about'):\n"
        "    window.actions_table[name].trigger(); settle()\n"
        "for dialog in window.findChildren(QDialog):\n"
        "    dialog.resize(1, 1); settle(); least = dialog.size()\n"
        "    sizes.append((least.width(), least.height(), dialog.windowTitle()))\n"
        "print(window.devicePixelRatio(), len(sizes), [s for s in sizes if s[0] > 960 or s[1] > 540])\n"
        "window.close()\n"
    )
    environment = {**os.environ, "QT_SCALE_FACTOR": "2", "QT_QPA_PLATFORM": "offscreen"}
    here = str(Path(__file__).parent)
    done = subprocess.run(
        [sys.executable, "-c", program, here, str(tmp_path / "window.ini")],
        capture_output=True, text=True, timeout=120, env=environment, check=False,
    )  # fmt: skip
    ratio, count, wide = done.stdout.strip().split(" ", 2) if done.stdout.strip() else ("", "", done.stderr)
    assert (ratio, wide) == ("2.0", "[]") and int(count) > 9, done.stderr


def test_the_first_window_fits_its_screen(window: MainWindow) -> None:
    room = window.screen().availableSize()
    assert window.width() < room.width() and window.height() < room.height()
    from nvsim_app.wiring import window as module

    assert window.size() == module._SIZE.boundedTo(room - module._RIM)


@pytest.mark.parametrize("size", [(952, 500), (1272, 680)])
def test_an_opened_project_does_not_enlarge_the_window(
    window: MainWindow, document: Document, qtbot: QtBot, size: tuple[int, int]
) -> None:
    opened = document.contents
    document.set_contents(Contents())
    window.show()
    window.resize(*size)
    qtbot.wait(50)
    document.set_contents(Contents(opened.path, reading=True))
    assert window.size().toTuple() == size
    document.set_contents(opened)
    for layout in WORKSPACE_LAYOUTS:
        window.actions_table[f"workspace_{layout.id}"].trigger()
        qtbot.wait(50)
        assert window.size().toTuple() == size, layout.id


def test_commands_without_room_in_the_tool_bar_are_in_a_menu(window: MainWindow, qtbot: QtBot) -> None:
    window.resize(960, 700)
    more = window._more_tools
    qtbot.waitUntil(more.isVisible, timeout=3000)
    bar = more.parentWidget()
    assert not more.icon().isNull() and bar.rect().contains(more.geometry())
    hidden = [a for a in bar.actions() if not a.isSeparator() and not bar.widgetForAction(a).isVisible()]
    texts = {action.text() for action in more.menu().actions()}
    assert hidden and {action.text() for action in hidden} <= texts


def test_escape_closes_the_dialog_in_front_wherever_the_focus_is(window: MainWindow, qtbot: QtBot) -> None:
    table = window.actions_table
    table["preferences"].trigger()
    (dialog,) = [d for d in window.findChildren(QDialog) if d.isVisible()]
    dialog.keys.editor.setFocus()
    qtbot.keyClick(dialog.keys.editor, Qt.Key.Key_Escape)
    assert not dialog.isVisible()
    table["help"].trigger()
    (page,) = [d for d in window.findChildren(QDialog) if d.isVisible()]
    window.activateWindow()
    window.scene.setFocus()
    qtbot.waitUntil(window.isActiveWindow, timeout=3000)
    qtbot.keyClick(window.scene, Qt.Key.Key_Escape)
    assert not page.isVisible()


def test_escape_closes_the_dialog_that_was_raised_last_first(window: MainWindow, qtbot: QtBot) -> None:
    table = window.actions_table
    for name in ("preferences", "help"):
        table[name].trigger()
    first, second = (d for d in window.findChildren(QDialog) if d.isVisible())
    for raised in (second, first, window):
        raised.activateWindow()
        qtbot.waitUntil(raised.isActiveWindow, timeout=3000)
    window.scene.setFocus()
    qtbot.keyClick(window.scene, Qt.Key.Key_Escape)
    assert not first.isVisible() and second.isVisible()
    qtbot.keyClick(window.scene, Qt.Key.Key_Escape)
    assert not second.isVisible()


@pytest.mark.parametrize(
    "name", ["preferences", "help", "new_project", "models", "job_train", "job_map", "export_tasks", "about"]
)
def test_the_buttons_of_a_dialog_are_on_a_small_screen(
    window: MainWindow, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    class Small:
        def availableSize(self) -> QSize:
            return QSize(960, 540)

    monkeypatch.setattr(Dialog, "screen", lambda self: Small())
    window.actions_table[name].trigger()
    (dialog,) = (found for found in window.findChildren(QDialog) if found.isVisible())
    qtbot.wait(50)
    assert dialog.width() <= 960 and dialog.height() <= 540 - 40
    for button in dialog.findChildren(QDialogButtonBox):
        assert dialog.rect().contains(button.geometry())
    dialog.close()
