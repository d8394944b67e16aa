"""Workspaces: panels for one kind of work, in the layout of the user. Panels that do not apply to the open file are
hidden."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import demo_room
import pytest
from PySide6.QtCore import QSettings, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QMenu, QStyle, QStyleOptionTab, QTabBar, QToolButton
from pytestqt.qtbot import QtBot

from nvsim.graph.connectivity import write_connectivity
from nvsim_app.look import theme as themes
from nvsim_app.look.notices import Notices
from nvsim_app.palette.entries import commands, matching_entries
from nvsim_app.session import Session
from nvsim_app.state.document import Document
from nvsim_app.state.loading import Contents
from nvsim_app.wiring.window import MainWindow
from nvsim_app.wiring.workspace_layouts import WORKSPACE_LAYOUTS, WorkspacePart

MakeWindow = Callable[[Document], MainWindow]


def shown(window: MainWindow) -> set[str]:
    return {name for name, dock in window.docks.items() if not dock.isHidden()}


def arrangement(window: MainWindow) -> dict[str, tuple[int, int, bool]]:
    """Panel -> width, height, and whether it is in front of its tabs."""
    QApplication.processEvents()
    found = {name: dock for name, dock in window.docks.items() if not dock.isHidden()}
    return {name: (d.width(), d.height(), not d.visibleRegion().isEmpty()) for name, d in found.items()}


def enter(window: MainWindow, id: str) -> None:
    window.actions_table[f"workspace_{id}"].trigger()


def test_each_workspace_has_its_panels_a_key_and_a_place_in_menu_and_palette(
    window: MainWindow, document: Document
) -> None:
    assert window.part(WorkspacePart).current.id == "explore"
    for layout in WORKSPACE_LAYOUTS:
        enter(window, layout.id)
        panels = window.part(WorkspacePart).panels(layout.id)
        assert shown(window) == panels - {"results"}  # nothing was evaluated yet
        assert window.actions_table[f"workspace_{layout.id}"].isChecked()
        assert set(layout.front) <= panels <= set(window.docks)
    (menu,) = [m for m in window.findChildren(QMenu) if m.title() == "&Workspace"]
    texts = [action.text().replace("&", "") for action in menu.actions()]
    assert texts == ["Explore workspace", "Train workspace", "Edit graph workspace", "Compare workspace"]
    found = matching_entries(commands(window.actions_table, document), "train workspace", [])
    assert found[0].title == "Train workspace" and found[0].shortcut == "Alt+2"


def test_what_the_user_made_of_a_workspace_is_kept_in_it_and_can_be_reset(
    make_window: MakeWindow, document: Document
) -> None:
    first = make_window(document)
    first.docks["frames"].hide()
    first.show_dock("log")
    enter(first, "train")
    assert "frames" in shown(first)
    enter(first, "explore")
    assert "frames" not in shown(first) and "log" in shown(first)
    enter(first, "edit")
    first.close()
    second = make_window(document)
    assert second.part(WorkspacePart).current.id == "edit"
    enter(second, "explore")
    assert "frames" not in shown(second) and "log" in shown(second)
    second.actions_table["reset_layout"].trigger()
    assert "frames" in shown(second) and "log" not in shown(second)


def test_panels_with_nothing_to_say_are_closed_and_come_back(
    make_window: MakeWindow, document: Document, qtbot: QtBot
) -> None:
    contents = document.contents
    document.set_contents(replace(contents, graph=None, arrays=None, arrays_of=None))
    window = make_window(document)
    enter(window, "edit")
    assert shown(window) == {"map", "details"}
    window.show_dock("validation")  # asked for all the same
    document.set_contents(replace(document.contents, submaps=()))
    assert "validation" in shown(window)
    document.set_contents(contents)
    qtbot.waitUntil(lambda: "tables" in shown(window), timeout=5000)
    document.set_contents(Contents())
    assert shown(window) == set() and window.center.currentWidget() is window.start
    assert not window.actions_table["workspace_train"].isEnabled()
    document.set_contents(contents)
    qtbot.waitUntil(lambda: {"map", "tables"} <= shown(window), timeout=5000)


def test_an_empty_project_closes_its_panels_after_it_was_read(make_window: MakeWindow, qtbot: QtBot) -> None:
    document = Document()
    window = make_window(document)
    document.set_contents(Contents(Path("new.nvsim"), reading=True))
    assert "map" in shown(window)  # it may have a map, until it is read
    assert window.empty.sentence.text() == "Reading the file…" and not window.empty.imports.isVisible()
    window.show_dock("validation")
    findings = window.panels["validation"]
    assert findings.clean.text() == "Checking…"
    window.docks["validation"].hide()
    document.set_contents(Contents(Path("new.nvsim")))
    window.show_dock("validation")
    qtbot.waitUntil(lambda: findings.clean.text() == "No problems found.", timeout=5000)
    window.docks["validation"].hide()
    assert not shown(window) and window.empty.imports.isVisible()


def test_a_file_that_is_read_again_keeps_sizes_and_front_tabs(window: MainWindow, document: Document) -> None:
    enter(window, "edit")
    window.show_dock("history")
    contents, before = document.contents, arrangement(window)
    document.set_contents(Contents(contents.path, reading=True))
    assert window.panels["validation"].reason_for_no_findings == "Checking…"  # the graph is not read yet
    document.set_contents(contents)
    assert arrangement(window) == before


@pytest.mark.parametrize("name", ["scene", "map"])
def test_one_key_shows_one_view_alone_and_the_same_key_brings_all_back(
    window: MainWindow, name: str, qtbot: QtBot
) -> None:
    part = window.part(WorkspacePart)
    before = shown(window)
    focused = window.scene if name == "scene" else window.panels["map"]
    window.activateWindow()
    focused.setFocus()
    qtbot.waitUntil(lambda: QApplication.focusWidget() is not None, timeout=5000)
    wide = focused.width()
    qtbot.keyClick(window, Qt.Key.Key_F12)
    assert part.shows_one_view and shown(window) == (set() if name == "scene" else {"map"})
    assert window.center.isVisible() == (name == "scene")
    qtbot.waitUntil(lambda: focused.width() > 1.5 * wide, timeout=5000)
    if name == "map":
        window.notices.error("It broke.")  # is told over the center
        assert window.center.isVisible()
    else:
        qtbot.keyClick(window, Qt.Key.Key_F12)
    assert not part.shows_one_view and shown(window) == before


def test_a_workspace_leaves_no_tab_bar_behind(window: MainWindow, qtbot: QtBot) -> None:
    for id in ("train", "edit", "explore", "edit", "compare"):
        enter(window, id)
    window.actions_table["maximise"].trigger()
    window.actions_table["maximise"].trigger()
    qtbot.wait(20)
    direct = Qt.FindChildOption.FindDirectChildrenOnly
    seen = [b for b in window.findChildren(QTabBar, options=direct) if b.isVisible() and b.geometry().x() >= 0]
    titles = window.dock_titles
    for bar in seen:
        assert {bar.tabText(i) for i in range(bar.count())} <= {titles[name] for name in shown(window)}
    texts = [tuple(bar.tabText(i) for i in range(bar.count())) for bar in seen]
    assert texts and len(set(texts)) == len(texts)


def test_a_graph_file_and_a_splat_file_show_what_concerns_them(
    settings: QSettings, tmp_path: Path, qtbot: QtBot
) -> None:
    from test_splat_file import pole

    from nvsim.splats.formats.choice import write_splats

    graph = demo_room.graph(demo_room.submaps(demo_room.capture()))
    write_connectivity(replace(graph, scan="one"), tmp_path)
    write_splats(tmp_path / "pole.spz", pole(), False, "spz")
    session = Session(settings)
    qtbot.addWidget(session.window)
    window = session.window
    window.show()
    part = window.part(WorkspacePart)
    try:
        session.open(tmp_path / "one_connectivity.json")
        wanted = {"history", "map", "details", "validation", "inspector", "tables", "histogram"}
        qtbot.waitUntil(lambda: shown(window) == wanted, timeout=20_000)
        assert part.current.id == "edit" and part.kind == "graph"
        session.open(tmp_path / "pole.spz")
        qtbot.waitUntil(lambda: shown(window) == {"layers", "camera_path"}, timeout=20_000)
        assert part.current.id == "explore" and part.kind == "splats"
        session.close_project()
        assert shown(window) == set()
    finally:
        session.close()
        qtbot.waitUntil(lambda: not window.scene.link.ready, timeout=20_000)


def test_whatever_stands_in_the_settings_of_a_workspace_is_survived(
    settings: QSettings, document: Document, qtbot: QtBot
) -> None:
    settings.setValue("workspace/project", "kitchen")
    settings.setValue("workspaces/explore/project/panels", {"a": 1})
    settings.setValue("workspaces/explore/project/state", "none")
    window = MainWindow(document, settings, Notices())
    qtbot.addWidget(window)
    window.show()
    assert {"map", "layers"} <= shown(window)
    settings.setValue("workspaces/train/project/panels", ["jobs", "nonsense"])
    settings.setValue("workspaces/train/project/state", window.saveState(3))
    enter(window, "train")
    assert "jobs" in shown(window)
    window.close()


@pytest.mark.parametrize("size", [(1280, 720), (1600, 1000)])
def test_the_map_is_the_main_view_where_the_graph_is_edited(
    window: MainWindow, qtbot: QtBot, size: tuple[int, int]
) -> None:
    window.resize(*size)
    QApplication.processEvents()
    QTest.keyClick(window, Qt.Key.Key_3, Qt.KeyboardModifier.AltModifier)
    QApplication.processEvents()
    # Qt puts docks behind other tabs outside the window.
    views = {name: dock for name, dock in window.docks.items() if dock.isVisible() and dock.x() >= 0}
    area = {name: dock.width() * dock.height() for name, dock in views.items()}
    assert area["map"] > 1.2 * max(area["validation"], window.center.width() * window.center.height())
    assert not [tab for tab in window.tabifiedDockWidgets(window.docks["map"]) if not tab.isHidden()]
    bar = next(b for b in window.findChildren(QTabBar) if b.isVisible() and "Validation" in _tabs(b))
    assert all(bar.tabRect(i).width() >= bar.tabSizeHint(i).width() for i in range(bar.count())), "no tab is cut"
    assert {"Viewpoints and edges", "History"} <= set(
        next(_tabs(b) for b in window.findChildren(QTabBar) if b.isVisible() and "History" in _tabs(b))
    )
    QTest.keyClick(window, Qt.Key.Key_1, Qt.KeyboardModifier.AltModifier)
    QApplication.processEvents()
    assert window.center.width() * window.center.height() > views["map"].width() * views["map"].height()


def _tabs(bar: QTabBar) -> list[str]:
    return [bar.tabText(i) for i in range(bar.count())]


def test_keys_act_on_the_graph_after_a_workspace_is_entered(window: MainWindow, document: Document) -> None:
    window.activateWindow()
    for key in (Qt.Key.Key_2, Qt.Key.Key_3):
        QTest.keyClick(window.focusWidget() or window, key, Qt.KeyboardModifier.AltModifier)
        QApplication.processEvents()
        QTest.keyClick(window.focusWidget() or window, Qt.Key.Key_P)
        assert window.modes.current.name == "add_viewpoint"
        assert not window.panels["tables"].filter.text() and not window.panels["validation"].text.text()
        QTest.keyClick(window.focusWidget() or window, Qt.Key.Key_V)


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_tabs_without_room_for_their_titles_scroll(window: MainWindow, qtbot: QtBot, theme: str) -> None:
    themes.apply(QApplication.instance(), theme)
    window.resize(960, 540)
    enter(window, "edit")
    for name in ("agent", "clean"):
        window.show_dock(name)
    qtbot.wait(100)
    bars = [b for b in window.findChildren(QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly)]
    (bar,) = [b for b in bars if b.isVisible() and "Agent" in [b.tabText(i) for i in range(b.count())]]
    needed = [bar.fontMetrics().horizontalAdvance(bar.tabText(tab)) for tab in range(bar.count())]
    assert sum(needed) > 0.8 * bar.width() and not [text for text in cut_titles(bar)]
    assert bar.rect().contains(bar.tabRect(bar.currentIndex()).center())
    back, _ = sorted((b for b in bar.findChildren(QToolButton) if b.isVisible()), key=lambda b: b.x())
    while not bar.rect().contains(bar.tabRect(0).center()):
        before = bar.tabRect(0).x()
        qtbot.mouseClick(back, Qt.MouseButton.LeftButton)
        assert bar.tabRect(0).x() > before
    qtbot.mouseClick(bar, Qt.MouseButton.LeftButton, pos=bar.tabRect(0).center())
    assert bar.currentIndex() == 0 and window.panels["details"].isVisible()
    assert all(bar.tabToolTip(tab) == bar.tabText(tab) for tab in range(bar.count()))


def cut_titles(bar: QTabBar) -> list[str]:
    """The titles that have less room than they need."""
    found = []
    for tab in range(bar.count()):
        option = QStyleOptionTab()
        bar.initStyleOption(option, tab)
        room = bar.style().subElementRect(QStyle.SubElement.SE_TabBarTabText, option, bar).width() + 2
        if bar.fontMetrics().horizontalAdvance(bar.tabText(tab)) > room:
            found.append(bar.tabText(tab))
    return found
