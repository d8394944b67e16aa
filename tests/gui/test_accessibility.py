"""By keyboard alone, by ear, and without colors."""

from __future__ import annotations

import itertools

import pytest
from PySide6.QtCore import QEvent, QPoint, QRect, Qt
from PySide6.QtGui import QAccessible, QColor, QPalette
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractScrollArea,
    QAbstractSlider,
    QAbstractSpinBox,
    QApplication,
    QComboBox,
    QLabel,
    QProgressBar,
    QScrollBar,
    QTabBar,
    QTabWidget,
    QWidget,
)
from pytestqt.qtbot import QtBot
from test_window import contrast

from nvsim.figures import SHAPES
from nvsim_app.forms.fields import Settings
from nvsim_app.forms.form import CommandForm
from nvsim_app.look import colors, theme
from nvsim_app.painting.primitives import disc
from nvsim_app.panels.help import open_help
from nvsim_app.state.document import Document
from nvsim_app.state.graph_coloring import coloring
from nvsim_app.wiring.appearance import FocusPart, PreferencePart
from nvsim_app.wiring.display import _LINES
from nvsim_app.wiring.window import MainWindow

TAB = Qt.FocusPolicy.TabFocus
_INNER = (QTabBar, QTabWidget, QScrollBar, QLabel)


def controls(window: QWidget) -> list[QWidget]:
    """The controls of the user, without the child widgets that Qt creates."""
    found = []
    for each in window.findChildren(QWidget):
        parent = each.parent()
        works = each.focusPolicy() != Qt.FocusPolicy.NoFocus or isinstance(
            each, (QAbstractButton, QAbstractSlider, QProgressBar)
        )
        inner = isinstance(each, _INNER) or isinstance(parent, (QAbstractSpinBox, QComboBox, QTabBar, QTabWidget))
        inner |= isinstance(parent, QAbstractScrollArea) and parent.viewport() is each
        inner |= each.objectName().startswith("qt_") or "Private" in type(parent).__name__
        inner |= each.metaObject().className() in ("QComboBoxListView", "QDockWidgetTitleButton", "QLineEditIconButton")
        inner |= each.metaObject().className() == "QTableCornerButton"
        if works and not inner:
            found.append(each)
    return found


def nameless(window: QWidget) -> list[str]:
    said = []
    for each in controls(window):
        interface = QAccessible.queryAccessibleInterface(each)
        if interface is None or not interface.text(QAccessible.Text.Name):
            said.append(f"{type(each).__name__} in {type(each.parent()).__name__}, {each.toolTip()[:40]}")
    return said


def test_every_control_of_the_window_has_a_name(window: MainWindow, document: Document) -> None:
    document.select(viewpoint=document.graph_arrays.ids[0])
    assert len(controls(window)) > 100
    assert nameless(window) == []


def test_every_control_of_the_dialogs_has_a_name(window: MainWindow, tmp_path, qtbot: QtBot) -> None:
    form = CommandForm("train", "Train", tmp_path, Settings(tmp_path), window)
    for dialog in (window.part(PreferencePart).open(), open_help("keys", window), form):
        assert nameless(dialog) == []
        dialog.close()


def test_a_control_without_a_name_is_found(qtbot: QtBot) -> None:
    holder = QWidget()
    qtbot.addWidget(holder)
    box = QComboBox(holder)
    assert len(nameless(holder)) == 1
    box.setAccessibleName("Storey")
    assert nameless(holder) == []


def in_front(each: QWidget) -> bool:
    """Not in a panel behind another's tab, which Qt moves out of the window."""
    window = each.window()
    return window.rect().intersects(QRect(each.mapTo(window, QPoint()), each.size()))


def test_tab_reaches_every_control_that_is_seen(window: MainWindow, document: Document, qtbot: QtBot) -> None:
    window.resize(1600, 1000)
    window.activateWindow()
    qtbot.wait(50)  # the panels find their places
    qtbot.waitUntil(window.isActiveWindow, timeout=3000)
    window.scene.setFocus()
    reached: list[QWidget] = []
    for _ in range(400):
        now = QApplication.focusWidget()
        if now is None or (reached and now is reached[0]):
            break
        reached.append(now)
        QTest.keyClick(now, Qt.Key.Key_Tab)
    wanted = [
        each
        for each in controls(window)
        if each.isVisible() and each.isEnabled() and each.focusPolicy() & TAB and in_front(each)
    ]
    assert len(wanted) > 9 and [type(w).__name__ for w in wanted if w not in reached] == []
    assert QApplication.focusWidget() is reached[0], "and comes back"


def test_a_key_goes_from_pane_to_pane_and_a_ring_shows_where_it_is(window: MainWindow, qtbot: QtBot) -> None:
    window.resize(1600, 1000)
    window.activateWindow()
    qtbot.wait(50)  # the panels find their places
    qtbot.waitUntil(window.isActiveWindow, timeout=3000)
    part = window.part(FocusPart)
    panes = part.panes()
    assert {title for title, _ in panes} >= {"3D view", "Layers", "Map"}
    window.scene.setFocus()
    assert part.ring.isVisible() and part.ring.size() == window.scene.size()
    visited = []
    for _ in panes:
        window.actions_table["next_pane"].trigger()
        focus = QApplication.focusWidget()
        visited += [title for title, pane in panes if pane is focus or pane.isAncestorOf(focus)]
        if part.ring.isVisible():
            assert part.ring.around is focus
    assert sorted(visited) == sorted(title for title, _ in panes)
    before = QApplication.focusWidget()
    window.actions_table["next_pane"].trigger()
    window.actions_table["previous_pane"].trigger()
    assert QApplication.focusWidget() is before


@pytest.mark.parametrize("name", theme.THEMES)
def test_every_text_is_read_at_four_and_a_half_to_one(name: str) -> None:
    palette, role = theme.palette(name), QPalette.ColorRole
    grounds = [palette.color(each) for each in (role.Window, role.Base, role.AlternateBase)]
    pairs = {
        (each.name, ground.name()): (palette.color(each), ground)
        for each in (role.WindowText, role.Text, role.PlaceholderText, role.Link, role.LinkVisited)
        for ground in grounds
    }
    pairs |= {
        (meaning, ground.name()): (QColor(color), ground)
        for meaning, color in colors.TEXTS[name].items()
        for ground in grounds
    }
    for ink, paper in ((role.ButtonText, role.Button), (role.ToolTipText, role.ToolTipBase),
                       (role.HighlightedText, role.Highlight), (role.Text, role.ToolTipBase)):  # fmt: skip
        pairs[(ink.name, paper.name)] = (palette.color(ink), palette.color(paper))
    weak = {names: round(contrast(*pair), 2) for names, pair in pairs.items() if contrast(*pair) < 4.5}
    assert weak == {}
    assert contrast(palette.color(role.Link), palette.color(role.Window)) >= 3, "the ring of the focus"


def test_texts_follow_the_theme(window: MainWindow) -> None:
    from nvsim_app.panels.tables import TablePanel

    tables = window.panels["tables"]
    assert isinstance(tables, TablePanel)
    seen = []
    for name in theme.THEMES:
        window.preferences.set("theme", name)
        theme.apply(QApplication.instance(), name)
        QApplication.sendEvent(tables.trouble, QEvent(QEvent.Type.PaletteChange))  # as it comes while Qt runs
        seen.append(tables.trouble.palette().windowText().color().name())
    assert seen == [colors.TEXTS[name]["warning"] for name in theme.THEMES]
    window.preferences.set("theme", "dark")


def test_what_colors_say_shapes_and_lines_say_too(document: Document, qapp: QApplication) -> None:
    for by in ("degree", "evidence", "reviewed", "storey", "component", "submap"):
        groups = coloring(document, by).groups
        marks = [group.mark for group in groups]
        assert len(set(marks)) == len(marks) and len({g.color for g in groups}) == len(groups)
    assert len(set(_LINES)) == len(_LINES) >= 5
    pictures = [disc("#ffffff", "#000000", shape=shape).toImage() for shape in SHAPES]
    assert all(a != b for a, b in itertools.combinations(pictures, 2))
